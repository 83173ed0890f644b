/* The functions of FMI 3.0 that the model description says are not supported: other interface types,
 * states, arrays, derivatives, and intervals that an importer sets. */
#include <stddef.h>

#include "plant.h"
#include "fmi/fmi3Functions.h"

#pragma GCC diagnostic ignored "-Wunused-parameter"

#define REFUSED(name, ...)                                                          \
  fmi3Status name(__VA_ARGS__) {                                                    \
    plant *const *self = c; /* the first member of an instance */                   \
    if (self == NULL) return fmi3Error;                                             \
    return (fmi3Status)plant_say(*self, PLANT_ERROR, #name " is not supported by this FMU"); \
  }

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
  if (log != NULL)
    log(environment, fmi3Error, "logStatusError", "this FMU is for co-simulation only");
  return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
  if (log != NULL)
    log(environment, fmi3Error, "logStatusError", "this FMU is for co-simulation only");
  return NULL;
}

#define LIST fmi3Instance c, const fmi3ValueReference references[], size_t count

REFUSED(fmi3EnterConfigurationMode, fmi3Instance c)
REFUSED(fmi3ExitConfigurationMode, fmi3Instance c)
REFUSED(fmi3GetFloat32, LIST, fmi3Float32 values[], size_t value_count)
REFUSED(fmi3SetFloat32, LIST, const fmi3Float32 values[], size_t value_count)
REFUSED(fmi3GetNumberOfVariableDependencies, fmi3Instance c, fmi3ValueReference reference,
        size_t *count)
REFUSED(fmi3GetVariableDependencies, fmi3Instance c, fmi3ValueReference dependent,
        size_t dependent_elements[], fmi3ValueReference independents[],
        size_t independent_elements[], fmi3DependencyKind kinds[], size_t count)
REFUSED(fmi3GetFMUState, fmi3Instance c, fmi3FMUState *state)
REFUSED(fmi3SetFMUState, fmi3Instance c, fmi3FMUState state)
REFUSED(fmi3FreeFMUState, fmi3Instance c, fmi3FMUState *state)
REFUSED(fmi3SerializedFMUStateSize, fmi3Instance c, fmi3FMUState state, size_t *size)
REFUSED(fmi3SerializeFMUState, fmi3Instance c, fmi3FMUState state, fmi3Byte data[], size_t size)
REFUSED(fmi3DeserializeFMUState, fmi3Instance c, const fmi3Byte data[], size_t size,
        fmi3FMUState *state)
REFUSED(fmi3GetDirectionalDerivative, fmi3Instance c, const fmi3ValueReference unknowns[],
        size_t unknown_count, const fmi3ValueReference knowns[], size_t known_count,
        const fmi3Float64 seed[], size_t seed_count, fmi3Float64 sensitivity[],
        size_t sensitivity_count)
REFUSED(fmi3GetAdjointDerivative, fmi3Instance c, const fmi3ValueReference unknowns[],
        size_t unknown_count, const fmi3ValueReference knowns[], size_t known_count,
        const fmi3Float64 seed[], size_t seed_count, fmi3Float64 sensitivity[],
        size_t sensitivity_count)
REFUSED(fmi3GetShiftDecimal, LIST, fmi3Float64 shifts[])
REFUSED(fmi3GetShiftFraction, LIST, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
REFUSED(fmi3SetIntervalDecimal, LIST, const fmi3Float64 intervals[])
REFUSED(fmi3SetIntervalFraction, LIST, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
REFUSED(fmi3SetShiftDecimal, LIST, const fmi3Float64 shifts[])
REFUSED(fmi3SetShiftFraction, LIST, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
REFUSED(fmi3EnterContinuousTimeMode, fmi3Instance c)
REFUSED(fmi3CompletedIntegratorStep, fmi3Instance c, fmi3Boolean no_set_state,
        fmi3Boolean *event_mode, fmi3Boolean *terminate)
REFUSED(fmi3SetTime, fmi3Instance c, fmi3Float64 time)
REFUSED(fmi3SetContinuousStates, fmi3Instance c, const fmi3Float64 states[], size_t count)
REFUSED(fmi3GetContinuousStateDerivatives, fmi3Instance c, fmi3Float64 derivatives[], size_t count)
REFUSED(fmi3GetEventIndicators, fmi3Instance c, fmi3Float64 indicators[], size_t count)
REFUSED(fmi3GetContinuousStates, fmi3Instance c, fmi3Float64 states[], size_t count)
REFUSED(fmi3GetNominalsOfContinuousStates, fmi3Instance c, fmi3Float64 nominals[], size_t count)
REFUSED(fmi3GetNumberOfEventIndicators, fmi3Instance c, size_t *count)
REFUSED(fmi3GetNumberOfContinuousStates, fmi3Instance c, size_t *count)
REFUSED(fmi3GetOutputDerivatives, LIST, const fmi3Int32 orders[], fmi3Float64 values[],
        size_t value_count)
REFUSED(fmi3ActivateModelPartition, fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
