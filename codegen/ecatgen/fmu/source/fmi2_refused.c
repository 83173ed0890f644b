/* The functions of FMI 2.0 that the model description says are not supported. */
#include <stddef.h>

#include "plant.h"
#include "fmi/fmi2Functions.h"

#pragma GCC diagnostic ignored "-Wunused-parameter"

#define REFUSED(name, ...)                                                          \
  fmi2Status name(__VA_ARGS__) {                                                    \
    plant *const *self = c; /* the first member of an instance */                   \
    if (self == NULL) return fmi2Error;                                             \
    return (fmi2Status)plant_say(*self, PLANT_ERROR, #name " is not supported by this FMU"); \
  }

REFUSED(fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *state)
REFUSED(fmi2SetFMUstate, fmi2Component c, fmi2FMUstate state)
REFUSED(fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *state)
REFUSED(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size)
REFUSED(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte data[], size_t size)
REFUSED(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte data[], size_t size,
        fmi2FMUstate *state)
REFUSED(fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference unknowns[],
        size_t unknown_count, const fmi2ValueReference knowns[], size_t known_count,
        const fmi2Real seed[], fmi2Real sensitivity[])
REFUSED(fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference references[],
        size_t count, const fmi2Integer order[], const fmi2Real values[])
REFUSED(fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference references[],
        size_t count, const fmi2Integer order[], fmi2Real values[])
REFUSED(fmi2CancelStep, fmi2Component c)

/* A step is complete when its call returns, so there is never a pending step with a status. */
#define NOTHING_PENDING(name, Value) \
  fmi2Status name(fmi2Component c, const fmi2StatusKind kind, Value *value) { return fmi2Discard; }

NOTHING_PENDING(fmi2GetStatus, fmi2Status)
NOTHING_PENDING(fmi2GetRealStatus, fmi2Real)
NOTHING_PENDING(fmi2GetIntegerStatus, fmi2Integer)
NOTHING_PENDING(fmi2GetBooleanStatus, fmi2Boolean)
NOTHING_PENDING(fmi2GetStringStatus, fmi2String)
