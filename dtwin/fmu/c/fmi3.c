/* The functions of an FMI 3.0 co-simulation (https://fmi-standard.org, version 3.0.2). */
#if defined(FMI_STANDARD_HEADERS)
#include "fmi3Functions.h"
#else
#include "fmi3.h"
#endif

#include "instance.h"

/* The instance of a call, or a null pointer and an error. */
#define CALLED(call) instance_called(instance, call, __func__)

static void tell(struct instance *instance, enum outcome outcome, const char *category, const char *text)
{
    const fmi3LogMessageCallback log = (fmi3LogMessageCallback)instance->wishes.logger;
    log(instance->wishes.environment, (fmi3Status)outcome, category, text);
}

const char *fmi3GetVersion(void)
{
    return "3.0";
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    struct instance *self = CALLED(CALL_SET_DEBUG_LOGGING);
    return self == NULL ? fmi3Error : (fmi3Status)instance_set_logging(self, on, count, categories);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    const struct wishes wishes = {3, name, token, events, logging, environment, tell, (void (*)(void))log};
    (void)resources;
    (void)visible;
    (void)early_return;
    (void)intermediate;
    (void)count;
    (void)update;
    return instance_new(&wishes, __func__);
}

void fmi3FreeInstance(fmi3Instance instance)
{
    instance_free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    struct instance *self = CALLED(CALL_ENTER_INITIALIZATION_MODE);
    const double *given_tolerance = tolerance_defined ? &tolerance : NULL, *given_stop = stop_defined ? &stop : NULL;
    if (self == NULL || instance_set_up(self, given_tolerance, start, given_stop) != OUTCOME_OK) {
        return fmi3Error;
    }
    self->at.mode = MODE_INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    struct instance *self = CALLED(CALL_EXIT_INITIALIZATION_MODE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_begin(self);
}

/* A change of a discrete output is an event, at the end of the step in which it comes. Nothing is left to do then. */
fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    struct instance *self = CALLED(CALL_ENTER_EVENT_MODE);
    if (self == NULL) {
        return fmi3Error;
    }
    if (!self->wishes.has_event_mode) {
        return (fmi3Status)instance_refuse(self, "expected an instance that was made with eventModeUsed");
    }
    self->at.mode = MODE_EVENT;
    return fmi3OK;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    return CALLED(CALL_EVENT_ITERATION) == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *next_defined,
                                    fmi3Float64 *next)
{
    struct instance *self = CALLED(CALL_EVENT_ITERATION);
    if (self == NULL) {
        return fmi3Error;
    }
    if (again == NULL || terminate == NULL || nominals == NULL || states == NULL || next_defined == NULL || next == NULL) {
        return (fmi3Status)instance_refuse(self, "expected addresses, got a null pointer");
    }
    *again = *terminate = *nominals = *states = *next_defined = false;
    *next = 0.0;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    struct instance *self = CALLED(CALL_ENTER_STEP_MODE);
    if (self == NULL) {
        return fmi3Error;
    }
    self->at.mode = MODE_STEPPING;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    struct instance *self = CALLED(CALL_TERMINATE);
    if (self == NULL) {
        return fmi3Error;
    }
    self->at.mode = MODE_TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    struct instance *self = CALLED(CALL_RESET);
    if (self == NULL) {
        return fmi3Error;
    }
    instance_reset(self);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 duration, fmi3Boolean forward,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    struct instance *self = CALLED(CALL_DO_STEP);
    enum outcome outcome;
    (void)forward;
    if (self == NULL) {
        return fmi3Error;
    }
    if (event == NULL || terminate == NULL || early == NULL || reached == NULL) {
        return (fmi3Status)instance_refuse(self, "expected addresses, got a null pointer");
    }
    outcome = instance_step(self, time, duration);
    *event = outcome == OUTCOME_OK && self->wishes.has_event_mode && self->at.event;
    *terminate = false;
    *early = false;
    *reached = self->at.time;
    return (fmi3Status)outcome;
}

/* ---- values ---- */

static bool has_as_many(struct instance *instance, size_t count, size_t value_count)
{
    if (count != value_count) {
        instance_refuse(instance, "expected as many values as value references, %lu, got %lu", (unsigned long)count,
                        (unsigned long)value_count);
    }
    return count == value_count;
}

#define GET(Name, type)                                                                                               \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count,              \
                             fmi3##Name values[], size_t value_count)                                                 \
    {                                                                                                                 \
        struct instance *self = CALLED(CALL_GET);                                                                     \
        size_t k;                                                                                                     \
        if (self == NULL || !has_as_many(self, count, value_count) ||                                                 \
            !instance_has_arrays(self, count, references, values) ||                                                  \
            instance_check_get(self, references, count, type) != OUTCOME_OK) {                                        \
            return fmi3Error;                                                                                         \
        }                                                                                                             \
        for (k = 0; k < count; ++k) {                                                                                 \
            instance_get(self, references[k], &values[k]);                                                            \
        }                                                                                                             \
        return fmi3OK;                                                                                                \
    }

#define SET(Name, type, place)                                                                                        \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t count,              \
                             const fmi3##Name values[], size_t value_count)                                           \
    {                                                                                                                 \
        struct instance *self = CALLED(CALL_SET);                                                                     \
        size_t k;                                                                                                     \
        if (self == NULL || !has_as_many(self, count, value_count) ||                                                 \
            !instance_has_arrays(self, count, references, values)) {                                                  \
            return fmi3Error;                                                                                         \
        }                                                                                                             \
        for (k = 0; k < count; ++k) {                                                                                 \
            const enum outcome outcome = instance_check_set(self, references[k], type, place values[k]);              \
            if (outcome != OUTCOME_OK) {                                                                              \
                return (fmi3Status)outcome;                                                                           \
            }                                                                                                         \
        }                                                                                                             \
        for (k = 0; k < count; ++k) {                                                                                 \
            instance_set(self, references[k], place values[k]);                                                       \
        }                                                                                                             \
        return fmi3OK;                                                                                                \
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
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_get_state(self, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_set_state(self, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_free_state(self, state);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_serialized_size(self, state, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_serialize(self, state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_deserialize(self, bytes, size, state);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t unknown_count,
                                        const fmi3ValueReference knowns[], size_t known_count,
                                        const fmi3Float64 seed[], size_t seed_count, fmi3Float64 moved[],
                                        size_t moved_count)
{
    struct instance *self = CALLED(CALL_GET_DIRECTIONAL_DERIVATIVE);
    if (self == NULL || !has_as_many(self, known_count, seed_count) || !has_as_many(self, unknown_count, moved_count)) {
        return fmi3Error;
    }
    return (fmi3Status)instance_derivative(self, unknowns, unknown_count, knowns, known_count, seed, moved);
}

/* ---- what these models have not ---- */

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define NONE(function, ...)                                                                                           \
    fmi3Status function(__VA_ARGS__)                                                                                  \
    {                                                                                                                 \
        CALLED(CALL_NEVER);                                                                                           \
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
NONE(fmi3GetBinary, fmi3Instance instance, const fmi3ValueReference r[], size_t n, size_t s[], fmi3Binary v[], size_t m)
NONE(fmi3SetBinary, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const size_t s[], const fmi3Binary v[],
     size_t m)
NONE(fmi3GetClock, fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3Clock v[])
NONE(fmi3SetClock, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Clock v[])
NONE(fmi3GetNumberOfVariableDependencies, fmi3Instance instance, fmi3ValueReference r, size_t *n)
NONE(fmi3GetVariableDependencies, fmi3Instance instance, fmi3ValueReference r, size_t a[], fmi3ValueReference b[], size_t c[],
     fmi3DependencyKind d[], size_t n)
NONE(fmi3GetAdjointDerivative, fmi3Instance instance, const fmi3ValueReference u[], size_t un, const fmi3ValueReference k[],
     size_t kn, const fmi3Float64 s[], size_t sn, fmi3Float64 v[], size_t vn)
NONE(fmi3EnterConfigurationMode, fmi3Instance instance)
NONE(fmi3ExitConfigurationMode, fmi3Instance instance)
NONE(fmi3GetIntervalDecimal, fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3Float64 v[],
     fmi3IntervalQualifier q[])
NONE(fmi3GetIntervalFraction, fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3UInt64 c[], fmi3UInt64 s[],
     fmi3IntervalQualifier q[])
NONE(fmi3GetShiftDecimal, fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3Float64 v[])
NONE(fmi3GetShiftFraction, fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3UInt64 c[], fmi3UInt64 s[])
NONE(fmi3SetIntervalDecimal, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[])
NONE(fmi3SetIntervalFraction, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3UInt64 c[],
     const fmi3UInt64 s[])
NONE(fmi3SetShiftDecimal, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[])
NONE(fmi3SetShiftFraction, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3UInt64 c[],
     const fmi3UInt64 s[])
NONE(fmi3GetOutputDerivatives, fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Int32 o[],
     fmi3Float64 v[], size_t m)
NONE(fmi3EnterContinuousTimeMode, fmi3Instance instance)
NONE(fmi3CompletedIntegratorStep, fmi3Instance instance, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *c)
NONE(fmi3SetTime, fmi3Instance instance, fmi3Float64 time)
NONE(fmi3SetContinuousStates, fmi3Instance instance, const fmi3Float64 x[], size_t n)
NONE(fmi3GetContinuousStateDerivatives, fmi3Instance instance, fmi3Float64 x[], size_t n)
NONE(fmi3GetEventIndicators, fmi3Instance instance, fmi3Float64 x[], size_t n)
NONE(fmi3GetContinuousStates, fmi3Instance instance, fmi3Float64 x[], size_t n)
NONE(fmi3GetNominalsOfContinuousStates, fmi3Instance instance, fmi3Float64 x[], size_t n)
NONE(fmi3GetNumberOfEventIndicators, fmi3Instance instance, size_t *n)
NONE(fmi3GetNumberOfContinuousStates, fmi3Instance instance, size_t *n)
NONE(fmi3ActivateModelPartition, fmi3Instance instance, fmi3ValueReference r, fmi3Float64 time)

/* What is no co-simulation has no token here. */
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    const struct wishes wishes = {3, name, NULL, false, logging, environment, tell, (void (*)(void))log};
    return instance_new(&wishes, __func__);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    const struct wishes wishes = {3, name, NULL, false, logging, environment, tell, (void (*)(void))log};
    return instance_new(&wishes, __func__);
}
