"""Every agent brakes to a halt and stays there."""

import numpy as np
import reactsim

DECELERATION = 3.4  # m/s²


class Stop(reactsim.Simulator):
    name = "stop-py"
    version = "1"

    def plan(self, seen):
        now = seen.states[:, :, -1]  # [episodes, agents, (x, y, heading, vx, vy)]
        position, velocity = now[..., :2], now[..., 3:]
        known = np.isfinite(velocity).all(axis=-1, keepdims=True)
        velocity = np.where(known, velocity, 0.0)
        plan = np.empty((*now.shape[:2], seen.steps, 3))
        plan[..., 2] = now[:, :, None, 2]
        for k in range(seen.steps):
            x, y = velocity[..., 0], velocity[..., 1]
            speed = np.sqrt(x * x + y * y)[..., None]
            slower = np.maximum(speed - DECELERATION * reactsim.DT, 0.0)
            factor = slower / np.where(speed > 0.0, speed, 1.0)
            velocity = np.where(speed > 0.0, velocity * factor, velocity)
            position = position + velocity * reactsim.DT
            plan[:, :, k, :2] = position
        return plan


if __name__ == "__main__":
    reactsim.serve(Stop())
