"""Every agent keeps its velocity and its heading."""

import numpy as np
import reactsim


class ConstantVelocity(reactsim.Simulator):
    name = "constant-velocity-py"
    version = "1"

    def plan(self, seen):
        now = seen.states[:, :, -1]  # [episodes, agents, (x, y, heading, vx, vy)]
        known = np.isfinite(now[..., 3:]).all(axis=-1, keepdims=True)
        velocity = np.where(known, now[..., 3:], 0.0)
        time = reactsim.DT * np.arange(1, seen.steps + 1)
        plan = np.empty((*now.shape[:2], seen.steps, 3))
        plan[..., :2] = now[:, :, None, :2] + velocity[:, :, None] * time[:, None]
        plan[..., 2] = now[:, :, None, 2]
        return plan


if __name__ == "__main__":
    reactsim.serve(ConstantVelocity())
