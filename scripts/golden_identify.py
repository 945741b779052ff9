#!/usr/bin/env python3
"""Golden numbers for crates/identify, from SciPy.

    python3 -m venv /tmp/venv-identify
    /tmp/venv-identify/bin/pip install numpy==2.4.6 scipy==1.17.1
    /tmp/venv-identify/bin/python scripts/golden_identify.py

Writes crates/identify/tests/golden/fits.json. `least_squares`: three problems with their data, the
optimum that SciPy's trust-region method finds within the bounds, its cost, and the covariance there
from slopes measured to high order, as if there were no bounds. Everything is drawn from fixed
seeds; a second run writes the same bytes.
"""

import json
import math
import pathlib

import numpy as np
from scipy.optimize import least_squares

OUT = pathlib.Path(__file__).resolve().parent.parent / "crates/identify/tests/golden/fits.json"
TIGHT = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": 2000}


def decay(x, case):
    times, data = np.array(case["times_secs"]), np.array(case["data"])
    return (x[0] * np.exp(-x[1] * times) + x[2] - data) / case["noise"]


def oscillate(x, step_secs, steps):
    """Positions of a damped oscillator released at 1, by the classical Runge-Kutta method."""
    stiffness, damping, cubic = x
    slope = lambda p, v: (v, -stiffness * p - damping * v - cubic * p**3)
    p, v, places, h = 1.0, 0.0, [], step_secs
    for _ in range(steps):
        a = slope(p, v)
        b = slope(p + 0.5 * h * a[0], v + 0.5 * h * a[1])
        c = slope(p + 0.5 * h * b[0], v + 0.5 * h * b[1])
        d = slope(p + h * c[0], v + h * c[1])
        p += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        v += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        places.append(p)
    return np.array(places)


def oscillator(x, case):
    data = np.array(case["data"])
    return (oscillate(x, case["step_secs"], len(data)) - data) / case["noise"]


def rosenbrock_residuals(x, case):
    """The chained valley, with a pull of each coordinate to -1: residuals at the optimum."""
    steep = [10 * (x[i + 1] - x[i] ** 2) for i in range(len(x) - 1)]
    flat = [1 - x[i] for i in range(len(x) - 1)]
    return np.array(steep + flat + [case["pull"] * (value + 1) for value in x])


def slopes(function, x):
    """Central differences, extrapolated twice (Richardson)."""
    columns = []
    for i in range(len(x)):
        def difference(h):
            e = np.zeros(len(x))
            e[i] = h * max(1.0, abs(x[i]))
            return (function(x + e) - function(x - e)) / (2 * e[i])

        coarse, middle, fine = difference(4e-3), difference(2e-3), difference(1e-3)
        first, second = (4 * middle - coarse) / 3, (4 * fine - middle) / 3
        columns.append((16 * second - first) / 15)
    return np.array(columns).T


def solved(name, function, case, start, bounds):
    residuals = lambda x: function(x, case)
    low, high = zip(*bounds)
    fit = least_squares(residuals, start, jac=lambda x: slopes(residuals, x), bounds=(low, high), method="trf", **TIGHT)
    j, r = slopes(residuals, fit.x), residuals(fit.x)
    covariance = np.linalg.inv(j.T @ j) * (r @ r) / (len(r) - len(fit.x))
    return {
        "name": name, **case, "start": start, "bounds": bounds,
        "optimum": fit.x.tolist(), "cost": float(fit.cost), "covariance": covariance.tolist(),
        "singular_values": np.linalg.svd(j, compute_uv=False).tolist(),
    }


def least_squares_cases():
    random = np.random.default_rng(5)
    times = np.linspace(0, 4, 60)
    # The true offset is below its lower bound, so the bound is active at the optimum.
    clean = 2.0 * np.exp(-0.9 * times) - 0.1
    decaying = {"times_secs": times.tolist(), "noise": 0.05}
    decaying["data"] = (clean + 0.05 * random.normal(size=len(times))).tolist()
    swinging = {"step_secs": 0.02, "noise": 0.02}
    clean = oscillate([25.0, 0.8, 6.0], 0.02, 200)
    swinging["data"] = (clean + 0.02 * random.normal(size=len(clean))).tolist()
    return [
        solved("decay", decay, decaying, [1.0, 0.3, 0.5], [[0.1, 5.0], [0.05, 4.0], [0.0, 1.0]]),
        solved("oscillator", oscillator, swinging, [20.0, 0.3, 1.0], [[5.0, 60.0], [0.05, 5.0], [0.0, 20.0]]),
        solved("rosenbrock", rosenbrock_residuals, {"pull": 0.3}, [-1.2, 1.0, 0.5], [[-2.0, 2.0]] * 3),
    ]


def main():
    OUT.parent.mkdir(parents=True, exist_ok=True)
    golden = {"least_squares": least_squares_cases()}
    for case in golden["least_squares"]:
        assert all(math.isfinite(value) for row in case["covariance"] for value in row), case["name"]
        print(case["name"], case["optimum"], case["cost"])
    OUT.write_text(json.dumps(golden, indent=1) + "\n")


if __name__ == "__main__":
    main()
