#!/usr/bin/env python3
"""An example of a planner for stockpilot: flies over whatever is unseen and near.

Question on stdin, answer on stdout: see src/service/external_planner/schema.md.
Needs nothing but Python 3.
"""

import json
import math
import sys

LEGS = 6  # of one answer; the service asks again after two waypoints


def main():
    ask = json.load(sys.stdin)
    grid, rules, lidar = ask["map"], ask["rules"], ask["lidar"]

    # Area that no beam has hit, in squares of about a metre: {(column, row): m2}.
    square_m = 1.0
    unseen = {}
    for cell, hits in enumerate(grid["n_hits"]):
        if hits == 0 and grid["area_m2"][cell] > 0.0:
            row, col = divmod(cell, grid["n_cols"])
            x = grid["x_min_m"] + (col + 0.5) * grid["cell_m"]
            y = grid["y_min_m"] + (row + 0.5) * grid["cell_m"]
            square = (int(x // square_m), int(y // square_m))
            unseen[square] = unseen.get(square, 0.0) + grid["area_m2"][cell]

    # The scan plane stands across the heading; half of what it reaches is relied on.
    drop_m = rules["height_m"] - rules["nominal_surface_m"]
    swath_m = 0.5 * drop_m * math.tan(lidar["swath_half_angle_rad"])

    def seen_on_leg(a, b):
        """Squares that come under the scan plane on the way from a to b."""
        squares = set()
        n = max(1, math.ceil(math.dist(a, b) / square_m))
        for k in range(n + 1):
            x = a[0] + (b[0] - a[0]) * k / n
            y = a[1] + (b[1] - a[1]) * k / n
            across = -swath_m
            while across <= swath_m:
                px = x - across * math.sin(rules["yaw_rad"])
                py = y + across * math.cos(rules["yaw_rad"])
                squares.add((int(px // square_m), int(py // square_m)))
                across += 0.5 * square_m
        return squares

    at = (ask["pending"][-1]["x_m"], ask["pending"][-1]["y_m"])
    for a, b in zip(ask["pending"], ask["pending"][1:]):
        for square in seen_on_leg((a["x_m"], a["y_m"]), (b["x_m"], b["y_m"])):
            unseen.pop(square, None)

    home = ask["over_home"] and (ask["over_home"]["x_m"], ask["over_home"]["y_m"])
    left_m = math.inf if ask["longest_m"] is None else ask["longest_m"]
    left_steps = ask["most_waypoints"]
    waypoints, is_complete = [], False
    while len(waypoints) < LEGS:
        best = None
        for place in ask["candidates"]:
            to = (place["x_m"], place["y_m"])
            way_m = math.dist(at, to)
            steps = max(1, math.ceil(way_m / rules["step_m"]))
            # A margin for ways around what stands between.
            home_m = math.dist(to, home) if home else 0.0
            if way_m < 0.5 or steps * 1.5 > left_steps or 1.2 * (way_m + home_m) > left_m:
                continue
            gain_m2 = sum(unseen.get(square, 0.0) for square in seen_on_leg(at, to))
            score = gain_m2 / (way_m + 2.0)
            if gain_m2 >= 1.0 and (best is None or score > best[0]):
                best = (score, to, place, way_m, steps)
        if best is None:
            is_complete = True
            break
        _, to, place, way_m, steps = best
        for square in seen_on_leg(at, to):
            unseen.pop(square, None)
        waypoints.append({key: place[key] for key in ("x_m", "y_m", "z_m", "yaw_rad")})
        at, left_m, left_steps = to, left_m - way_m, left_steps - steps

    json.dump({"waypoints": waypoints, "is_complete": is_complete}, sys.stdout)


if __name__ == "__main__":
    main()
