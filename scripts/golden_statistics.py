"""Statistics of scores by rliable (stratified bootstrap) and SciPy (one stratum).

    pip install rliable==1.2.0 "pandas<3" scipy numpy
    python scripts/golden_statistics.py > crates/experiment/tests/golden/statistics.json
"""

import json
import sys

import numpy as np
from rliable import library, metrics
from scipy import stats

RESAMPLES = 50_000


def by_rliable(scores):
    """`scores`: runs × songs."""
    point, interval = library.get_interval_estimates(
        {"x": scores},
        lambda x: np.array([metrics.aggregate_mean(x), metrics.aggregate_iqm(x)]),
        reps=RESAMPLES,
    )
    return point["x"], interval["x"]


def by_scipy(scores):
    """`scores`: one stratum."""
    def interval(statistic):
        found = stats.bootstrap((scores,), statistic, n_resamples=RESAMPLES, method="percentile", vectorized=False,
                                random_state=0)
        return [found.confidence_interval.low, found.confidence_interval.high]

    def iqm(x):
        return stats.trim_mean(x, 0.25)

    return [np.mean(scores), iqm(scores)], np.array([interval(np.mean), interval(iqm)]).T


def case(strata, point, interval):
    return {
        "strata": [list(map(float, s)) for s in strata],
        "mean": float(point[0]),
        "mean_interval": [float(interval[0][0]), float(interval[1][0])],
        "interquartile_mean": float(point[1]),
        "interquartile_mean_interval": [float(interval[0][1]), float(interval[1][1])],
    }


random = np.random.default_rng(7)
np.random.seed(7)
cases = []
for runs, songs in [(6, 5), (10, 4), (5, 2)]:
    scores = random.beta(12, 2, size=(runs, songs)) - 0.1 * np.arange(songs)
    cases.append(case(scores.T, *by_rliable(scores)))
for count in [8, 15]:
    scores = random.beta(8, 2, size=count)
    cases.append(case([scores], *by_scipy(scores)))
json.dump(cases, sys.stdout, indent=1)
