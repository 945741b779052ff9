"""Sizes and constants of the update that all peers run; the same as `etude_learn::DroqConfig::default()` and
`etude_learn::bench`: the paper's observation and action, three layers of 128, batch 256."""

REAL, BINARY, ACTION = 26, 343, 13
ONES = 15  # Ones among the binary columns of an average observation.
OBSERVATION = REAL + BINARY
HIDDEN = [128, 128, 128]
BATCH = 256
DROPOUT, EPSILON = 0.01, 1e-6
DISCOUNT, POLYAK, RATE = 0.8, 0.005, 3e-4
TARGET_ENTROPY = -0.5 * ACTION
LOG_STD = (-20.0, 2.0)


def batches(numpy, count=16, seed=0):
    """Random batches as dictionaries of float32 arrays, made before the clock starts: sampling is not measured."""
    generator = numpy.random.default_rng(seed)

    def observations():
        values = numpy.zeros((BATCH, OBSERVATION), numpy.float32)
        values[:, :REAL] = generator.uniform(-1, 1, (BATCH, REAL))
        for row in values:
            row[REAL + generator.integers(0, BINARY, ONES)] = 1
        return values

    return [
        {
            "observation": observations(),
            "next_observation": observations(),
            "action": generator.uniform(-1, 1, (BATCH, ACTION)).astype(numpy.float32),
            "reward": generator.uniform(0, 1, BATCH).astype(numpy.float32),
            "continues": numpy.ones(BATCH, numpy.float32),
        }
        for _ in range(count)
    ]
