/* Log-linear histogram: exact below 32 ns, then 32 buckets in every octave. */
#include <ecat/ecat_shm.h>

enum { STEPS = 32, STEPS_LOG2 = 5 };

unsigned ecat_histogram_bucket(uint64_t ns) {
  unsigned octave, bucket;
  if (ns < STEPS) return (unsigned)ns;
  octave = 63u - (unsigned)__builtin_clzll(ns) - STEPS_LOG2;
  bucket = octave * STEPS + (unsigned)(ns >> octave);
  return bucket < ECAT_HISTOGRAM_BUCKETS ? bucket : ECAT_HISTOGRAM_BUCKETS - 1;
}

uint64_t ecat_histogram_bound(unsigned bucket) {
  unsigned octave;
  if (bucket < STEPS) return bucket;
  octave = bucket / STEPS - 1;
  return (uint64_t)(bucket % STEPS + STEPS) << octave;
}

uint64_t ecat_histogram_quantile(const ecat_shm_histogram *histogram, double q) {
  uint64_t total = 0, seen = 0, rank, bound, max;
  unsigned i;
  /* Summed here rather than taken from `count`: the engine may be counting meanwhile. */
  for (i = 0; i < ECAT_HISTOGRAM_BUCKETS; i++)
    total += __atomic_load_n(&histogram->buckets[i], __ATOMIC_RELAXED);
  if (total == 0) return 0;
  max = __atomic_load_n(&histogram->max_ns, __ATOMIC_RELAXED);
  if (!(q < 1)) return max;
  rank = q > 0 ? (uint64_t)(q * (double)total) : 0;
  for (i = 0; i + 1 < ECAT_HISTOGRAM_BUCKETS; i++) {
    seen += __atomic_load_n(&histogram->buckets[i], __ATOMIC_RELAXED);
    if (seen > rank) break;
  }
  if (i + 1 == ECAT_HISTOGRAM_BUCKETS) return max; /* the last bucket has no upper edge */
  /* The upper edge of the bucket, so that "99 % stay below" is true. */
  bound = ecat_histogram_bound(i + 1);
  return bound < max ? bound : max;
}
