/* The functions of an FMI 3.0 co-simulation (https://fmi-standard.org, version 3.0.2). */
#if defined(FMI_STANDARD_HEADERS)
#include "fmi3Functions.h"
#else
#include "fmi3.h"
#endif

#include <stdlib.h>
#include <string.h>

#include "instance.h"

static void tell(struct instance *instance, const char *message)
{
    const fmi3LogMessageCallback log = (fmi3LogMessageCallback)instance->logger;
    if (log != NULL) {
        log(instance->environment, fmi3Error, "logStatusError", message);
    }
}

static fmi3Status status_of(bool good)
{
    return good ? fmi3OK : fmi3Error;
}

const char *fmi3GetVersion(void)
{
    return "3.0";
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    (void)instance;
    (void)on;
    (void)count;
    (void)categories;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    struct instance *made = instance_new(token, name);
    (void)resources;
    (void)visible;
    (void)logging;
    (void)early_return;
    (void)intermediate;
    (void)count;
    (void)update;
    if (made == NULL) {
        if (log != NULL) {
            log(environment, fmi3Error, "logStatusError", "expected the instantiation token of modelDescription.xml");
        }
        return NULL;
    }
    made->tell = tell;
    made->logger = (void (*)(void))log;
    made->environment = environment;
    made->has_event_mode = events;
    return made;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    instance_free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    struct instance *self = instance;
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    self->mode = MODE_INITIALIZING;
    self->start_time = start;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    struct instance *self = instance;
    const bool good = instance_begin(self);
    if (self->has_event_mode) {
        self->mode = MODE_EVENT;
    }
    return status_of(good);
}

/* A change of a discrete output is an event, at the end of the step in which it comes. Nothing is left to do then. */
fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    ((struct instance *)instance)->mode = MODE_EVENT;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *next_defined,
                                    fmi3Float64 *next)
{
    (void)instance;
    *again = *terminate = *nominals = *states = *next_defined = false;
    *next = 0.0;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    ((struct instance *)instance)->mode = MODE_STEPPING;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    ((struct instance *)instance)->mode = MODE_TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    instance_reset(instance);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 duration, fmi3Boolean forward,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    const bool good = instance_step(instance, time, duration);
    const struct instance *self = instance;
    (void)forward;
    *event = self->has_event_mode && self->event;
    *terminate = false;
    *early = false;
    *reached = good ? time + duration : time;
    return status_of(good);
}

/* ---- values ---- */

#define GET(Name, type)                                                                                               \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count,              \
                             fmi3##Name values[], size_t value_count)                                                 \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        bool good = count == value_count;                                                                             \
        for (k = 0; good && k < count; ++k) {                                                                         \
            good = instance_get(instance, references[k], type, &values[k]);                                           \
        }                                                                                                             \
        return status_of(good);                                                                                       \
    }

#define SET(Name, type, place)                                                                                        \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count,              \
                             const fmi3##Name values[], size_t value_count)                                           \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        bool good = count == value_count;                                                                             \
        for (k = 0; good && k < count; ++k) {                                                                         \
            good = instance_set(instance, references[k], type, place values[k]);                                      \
        }                                                                                                             \
        return status_of(good);                                                                                       \
    }

GET(Float64, MODEL_REAL)
GET(Int32, MODEL_INTEGER)
GET(Boolean, MODEL_BOOLEAN)
GET(String, MODEL_TEXTUAL)
SET(Float64, MODEL_REAL, &)
SET(Int32, MODEL_INTEGER, &)
SET(Boolean, MODEL_BOOLEAN, &)
SET(String, MODEL_TEXTUAL, )

/* ---- the state ---- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    return status_of(instance_snapshot(instance, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    return status_of(instance_load(instance, state, instance_size()));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    (void)instance;
    (void)state;
    *size = instance_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    (void)instance;
    if (size < instance_size()) {
        return fmi3Error;
    }
    memcpy(bytes, state, instance_size());
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return status_of(instance_unpack(instance, bytes, size, state));
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t unknown_count,
                                        const fmi3ValueReference knowns[], size_t known_count,
                                        const fmi3Float64 seed[], size_t seed_count, fmi3Float64 moved[],
                                        size_t moved_count)
{
    return status_of(seed_count == known_count && moved_count == unknown_count &&
                     instance_derivative(instance, unknowns, unknown_count, knowns, known_count, seed, moved));
}

/* ---- what these models have not ---- */

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define NONE(function, ...)                                                                                           \
    fmi3Status function(__VA_ARGS__)                                                                                  \
    {                                                                                                                 \
        return fmi3Error;                                                                                             \
    }
#define WITHOUT(Name)                                                                                                 \
    NONE(fmi3Get##Name, fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3##Name v[], size_t m)      \
    NONE(fmi3Set##Name, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3##Name v[], size_t m)

WITHOUT(Float32)
WITHOUT(Int8)
WITHOUT(UInt8)
WITHOUT(Int16)
WITHOUT(UInt16)
WITHOUT(UInt32)
WITHOUT(Int64)
WITHOUT(UInt64)
NONE(fmi3GetBinary, fmi3Instance i, const fmi3ValueReference r[], size_t n, size_t s[], fmi3Binary v[], size_t m)
NONE(fmi3SetBinary, fmi3Instance i, const fmi3ValueReference r[], size_t n, const size_t s[], const fmi3Binary v[],
     size_t m)
NONE(fmi3GetClock, fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Clock v[])
NONE(fmi3SetClock, fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Clock v[])
NONE(fmi3GetNumberOfVariableDependencies, fmi3Instance i, fmi3ValueReference r, size_t *n)
NONE(fmi3GetVariableDependencies, fmi3Instance i, fmi3ValueReference r, size_t a[], fmi3ValueReference b[], size_t c[],
     fmi3DependencyKind d[], size_t n)
NONE(fmi3GetAdjointDerivative, fmi3Instance i, const fmi3ValueReference u[], size_t un, const fmi3ValueReference k[],
     size_t kn, const fmi3Float64 s[], size_t sn, fmi3Float64 v[], size_t vn)
NONE(fmi3EnterConfigurationMode, fmi3Instance i)
NONE(fmi3ExitConfigurationMode, fmi3Instance i)
NONE(fmi3GetIntervalDecimal, fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 v[],
     fmi3IntervalQualifier q[])
NONE(fmi3GetIntervalFraction, fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3UInt64 c[], fmi3UInt64 s[],
     fmi3IntervalQualifier q[])
NONE(fmi3GetShiftDecimal, fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 v[])
NONE(fmi3GetShiftFraction, fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3UInt64 c[], fmi3UInt64 s[])
NONE(fmi3SetIntervalDecimal, fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[])
NONE(fmi3SetIntervalFraction, fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3UInt64 c[],
     const fmi3UInt64 s[])
NONE(fmi3SetShiftDecimal, fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[])
NONE(fmi3SetShiftFraction, fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3UInt64 c[],
     const fmi3UInt64 s[])
NONE(fmi3EvaluateDiscreteStates, fmi3Instance i)
NONE(fmi3GetOutputDerivatives, fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Int32 o[],
     fmi3Float64 v[], size_t m)
NONE(fmi3EnterContinuousTimeMode, fmi3Instance i)
NONE(fmi3CompletedIntegratorStep, fmi3Instance i, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *c)
NONE(fmi3SetTime, fmi3Instance i, fmi3Float64 time)
NONE(fmi3SetContinuousStates, fmi3Instance i, const fmi3Float64 x[], size_t n)
NONE(fmi3GetContinuousStateDerivatives, fmi3Instance i, fmi3Float64 x[], size_t n)
NONE(fmi3GetEventIndicators, fmi3Instance i, fmi3Float64 x[], size_t n)
NONE(fmi3GetContinuousStates, fmi3Instance i, fmi3Float64 x[], size_t n)
NONE(fmi3GetNominalsOfContinuousStates, fmi3Instance i, fmi3Float64 x[], size_t n)
NONE(fmi3GetNumberOfEventIndicators, fmi3Instance i, size_t *n)
NONE(fmi3GetNumberOfContinuousStates, fmi3Instance i, size_t *n)
NONE(fmi3ActivateModelPartition, fmi3Instance i, fmi3ValueReference r, fmi3Float64 time)

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    return NULL;
}
