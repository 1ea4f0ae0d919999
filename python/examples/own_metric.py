"""Computes a metric next to those of the benchmark: the table and the page show it like them."""

import numpy as np
import reactsim


class Closest(reactsim.Metric):
    """Mean over vehicles of the smallest distance between their centre and that of the AV."""

    id = "mean-closest-distance"
    title = "Closest"
    unit = "m"
    direction = "higher"

    def score(self, case):
        scenario = case.scenario
        steps = case.states[:, 11:, :2]  # [agents, 80, (x, y)], NaN where absent
        distances = np.linalg.norm(steps - steps[0], axis=-1)
        distances[np.isnan(distances)] = np.inf
        closest = distances.min(axis=1)
        vehicles = np.flatnonzero((scenario.kinds == reactsim.Kind.VEHICLE) & np.isfinite(closest))
        vehicles = vehicles[vehicles != 0]
        if not len(vehicles):
            return None
        events = [
            self.event(
                scenario.agents[i],
                step=1 + int(distances[i].argmin()),
                partner=scenario.agents[0],
                distance=closest[i],
            )
            for i in vehicles
        ]
        return closest[vehicles].mean(), events


if __name__ == "__main__":
    results = reactsim.run(baselines=["idm"], limit=5, metrics=[Closest()], progress=False)
    print(results.table())
    reactsim.command("report", results, format="html", out="own-metric.html", progress=False)
