/* The functions of an FMI 2.0 co-simulation (https://fmi-standard.org, version 2.0.4). */
#if defined(FMI_STANDARD_HEADERS)
#include "fmi2Functions.h"
#else
#include "fmi2.h"
#endif

#include "instance.h"

/* The instance of a call, or a null pointer and an error. */
#define CALLED(call) instance_called(component, call, __func__)

static void tell(struct instance *instance, enum outcome outcome, const char *category, const char *text)
{
    const fmi2CallbackLogger log = (fmi2CallbackLogger)instance->wishes.logger;
    log(instance->wishes.environment, instance->name, (fmi2Status)outcome, category, "%s", text);
}

const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

const char *fmi2GetVersion(void)
{
    return "2.0";
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    struct instance *self = CALLED(CALL_SET_DEBUG_LOGGING);
    return self == NULL ? fmi2Error : (fmi2Status)instance_set_logging(self, on != fmi2False, count, categories);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    struct wishes wishes = {2, name, token, false, logging != fmi2False, NULL, tell, NULL};
    (void)resources;
    (void)visible;
    if (functions == NULL) {
        return NULL;
    }
    wishes.environment = functions->componentEnvironment;
    wishes.logger = (void (*)(void))functions->logger;
    if (type != fmi2CoSimulation) {
        wishes.token = NULL; /* of which there is no model */
    }
    return instance_new(&wishes, __func__);
}

void fmi2FreeInstance(fmi2Component component)
{
    instance_free(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop)
{
    struct instance *self = CALLED(CALL_SETUP_EXPERIMENT);
    const double *given_tolerance = tolerance_defined ? &tolerance : NULL, *given_stop = stop_defined ? &stop : NULL;
    return self == NULL ? fmi2Error : (fmi2Status)instance_set_up(self, given_tolerance, start, given_stop);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    struct instance *self = CALLED(CALL_ENTER_INITIALIZATION_MODE);
    if (self == NULL) {
        return fmi2Error;
    }
    if (!self->at.experiment.is_set) {
        return (fmi2Status)instance_refuse(self, "expected fmi2SetupExperiment before");
    }
    self->at.mode = MODE_INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    struct instance *self = CALLED(CALL_EXIT_INITIALIZATION_MODE);
    return self == NULL ? fmi2Error : (fmi2Status)instance_begin(self);
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    struct instance *self = CALLED(CALL_TERMINATE);
    if (self == NULL) {
        return fmi2Error;
    }
    self->at.mode = MODE_TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component)
{
    struct instance *self = CALLED(CALL_RESET);
    if (self == NULL) {
        return fmi2Error;
    }
    instance_reset(self);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real duration, fmi2Boolean forward)
{
    struct instance *self = CALLED(CALL_DO_STEP);
    (void)forward;
    return self == NULL ? fmi2Error : (fmi2Status)instance_step(self, time, duration);
}

/* ---- values ---- */

#define GET(Name, type, type_of_model)                                                                                \
    fmi2Status fmi2Get##Name(fmi2Component component, const fmi2ValueReference references[], size_t count,            \
                             fmi2##Name values[])                                                                     \
    {                                                                                                                 \
        struct instance *self = CALLED(CALL_GET);                                                                     \
        size_t k;                                                                                                     \
        if (self == NULL || !instance_has_arrays(self, count, references, values) ||                                  \
            instance_check_get(self, references, count, type) != OUTCOME_OK) {                                        \
            return fmi2Error;                                                                                         \
        }                                                                                                             \
        for (k = 0; k < count; ++k) {                                                                                 \
            type_of_model value;                                                                                      \
            instance_get(self, references[k], &value);                                                                \
            values[k] = value;                                                                                        \
        }                                                                                                             \
        return fmi2OK;                                                                                                \
    }

GET(Real, MODEL_REAL, double)
GET(Integer, MODEL_INTEGER, int32_t)
GET(Boolean, MODEL_BOOLEAN, bool)
GET(String, MODEL_TEXTUAL, const char *)

#define SET(Name, type, type_of_model, converted, place)                                                              \
    fmi2Status fmi2Set##Name(fmi2Component component, const fmi2ValueReference references[], size_t count,            \
                             const fmi2##Name values[])                                                               \
    {                                                                                                                 \
        struct instance *self = CALLED(CALL_SET);                                                                     \
        size_t k;                                                                                                     \
        if (self == NULL || !instance_has_arrays(self, count, references, values)) {                                  \
            return fmi2Error;                                                                                         \
        }                                                                                                             \
        for (k = 0; k < count; ++k) {                                                                                 \
            const type_of_model value = converted(values[k]);                                                         \
            const enum outcome outcome = instance_check_set(self, references[k], type, place value);                  \
            if (outcome != OUTCOME_OK) {                                                                              \
                return (fmi2Status)outcome;                                                                           \
            }                                                                                                         \
        }                                                                                                             \
        for (k = 0; k < count; ++k) {                                                                                 \
            const type_of_model value = converted(values[k]);                                                         \
            instance_set(self, references[k], place value);                                                           \
        }                                                                                                             \
        return fmi2OK;                                                                                                \
    }

#define SAME(value) (value)
/* A Boolean of FMI 2.0 as a byte that is 2 where it is neither false nor true. */
#define AS_BYTE(value) ((unsigned char)((value) == fmi2False ? 0 : (value) == fmi2True ? 1 : 2))

SET(Real, MODEL_REAL, double, SAME, &)
SET(Integer, MODEL_INTEGER, int32_t, SAME, &)
SET(Boolean, MODEL_BOOLEAN, unsigned char, AS_BYTE, &)
SET(String, MODEL_TEXTUAL, char *, SAME, )

/* ---- the state ---- */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi2Error : (fmi2Status)instance_get_state(self, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi2Error : (fmi2Status)instance_set_state(self, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi2Error : (fmi2Status)instance_free_state(self, state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi2Error : (fmi2Status)instance_serialized_size(self, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi2Error : (fmi2Status)instance_serialize(self, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    struct instance *self = CALLED(CALL_STATE);
    return self == NULL ? fmi2Error : (fmi2Status)instance_deserialize(self, bytes, size, state);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknowns[],
                                        size_t unknown_count, const fmi2ValueReference knowns[], size_t known_count,
                                        const fmi2Real seed[], fmi2Real moved[])
{
    struct instance *self = CALLED(CALL_GET_DIRECTIONAL_DERIVATIVE);
    return self == NULL ? fmi2Error
                        : (fmi2Status)instance_derivative(self, unknowns, unknown_count, knowns, known_count, seed, moved);
}

/* ---- the status: a step is over when its function returns ---- */

/* The instance where a status and its place are as expected; a null pointer, and the outcome, otherwise. */
static struct instance *asked(fmi2Component component, const char *function, bool is_known, const void *value,
                              fmi2Status *outcome)
{
    struct instance *self = instance_called(component, CALL_GET_STATUS, function);
    *outcome = fmi2Error;
    if (self != NULL && value == NULL) {
        instance_refuse(self, "expected an address, got a null pointer");
    } else if (self != NULL) {
        *outcome = is_known ? fmi2OK : (fmi2Status)instance_discard(self, "there is no such status of a finished step");
    }
    return *outcome == fmi2OK ? self : NULL;
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value)
{
    fmi2Status outcome;
    (void)kind;
    asked(component, __func__, false, value, &outcome);
    return outcome;
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value)
{
    fmi2Status outcome;
    const struct instance *self = asked(component, __func__, kind == fmi2LastSuccessfulTime, value, &outcome);
    if (self != NULL) {
        *value = self->at.time;
    }
    return outcome;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Integer *value)
{
    fmi2Status outcome;
    (void)kind;
    asked(component, __func__, false, value, &outcome);
    return outcome;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value)
{
    fmi2Status outcome;
    const struct instance *self = asked(component, __func__, kind == fmi2Terminated, value, &outcome);
    if (self != NULL) {
        *value = fmi2False;
    }
    return outcome;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind, fmi2String *value)
{
    fmi2Status outcome;
    (void)kind;
    asked(component, __func__, false, value, &outcome);
    return outcome;
}

/* ---- what these models have not: input and output derivatives, and steps that go on after their function ---- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                       const fmi2Integer orders[], const fmi2Real values[])
{
    (void)references;
    (void)count;
    (void)orders;
    (void)values;
    CALLED(CALL_NEVER);
    return fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                        const fmi2Integer orders[], fmi2Real values[])
{
    (void)references;
    (void)count;
    (void)orders;
    (void)values;
    CALLED(CALL_NEVER);
    return fmi2Error;
}

fmi2Status fmi2CancelStep(fmi2Component component)
{
    CALLED(CALL_NEVER);
    return fmi2Error;
}
