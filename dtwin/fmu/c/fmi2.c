/* The functions of an FMI 2.0 co-simulation (https://fmi-standard.org, version 2.0.4). */
#if defined(FMI_STANDARD_HEADERS)
#include "fmi2Functions.h"
#else
#include "fmi2.h"
#endif

#include <stdlib.h>
#include <string.h>

#include "instance.h"

static void tell(struct instance *instance, const char *message)
{
    const fmi2CallbackLogger log = (fmi2CallbackLogger)instance->logger;
    if (log != NULL) {
        log(instance->environment, instance->name, fmi2Error, "logStatusError", "%s", message);
    }
}

static fmi2Status status_of(bool good)
{
    return good ? fmi2OK : fmi2Error;
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
    (void)component;
    (void)on;
    (void)count;
    (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    struct instance *made = type == fmi2CoSimulation ? instance_new(token, name) : NULL;
    (void)resources;
    (void)visible;
    (void)logging;
    if (made == NULL) {
        if (functions->logger != NULL) {
            functions->logger(functions->componentEnvironment, name, fmi2Error, "logStatusError",
                              "expected a co-simulation with the GUID of modelDescription.xml");
        }
        return NULL;
    }
    made->tell = tell;
    made->logger = (void (*)(void))functions->logger;
    made->environment = functions->componentEnvironment;
    return made;
}

void fmi2FreeInstance(fmi2Component component)
{
    instance_free(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    ((struct instance *)component)->start_time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    ((struct instance *)component)->mode = MODE_INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    return status_of(instance_begin(component));
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    ((struct instance *)component)->mode = MODE_TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component)
{
    instance_reset(component);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real duration, fmi2Boolean forward)
{
    (void)forward;
    return status_of(instance_step(component, time, duration));
}

/* ---- values ---- */

#define GET(Name, type, type_of_model)                                                                                \
    fmi2Status fmi2Get##Name(fmi2Component component, const fmi2ValueReference references[], size_t count,            \
                             fmi2##Name values[])                                                                     \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        bool good = true;                                                                                             \
        for (k = 0; good && k < count; ++k) {                                                                         \
            type_of_model value;                                                                                      \
            good = instance_get(component, references[k], type, &value);                                              \
            if (good) {                                                                                               \
                values[k] = value;                                                                                    \
            }                                                                                                         \
        }                                                                                                             \
        return status_of(good);                                                                                       \
    }

GET(Real, MODEL_REAL, double)
GET(Integer, MODEL_INTEGER, int32_t)
GET(Boolean, MODEL_BOOLEAN, bool)
GET(String, MODEL_TEXTUAL, const char *)

#define SET(Name, type, type_of_model, converted, place)                                                              \
    fmi2Status fmi2Set##Name(fmi2Component component, const fmi2ValueReference references[], size_t count,            \
                             const fmi2##Name values[])                                                               \
    {                                                                                                                 \
        size_t k;                                                                                                     \
        bool good = true;                                                                                             \
        for (k = 0; good && k < count; ++k) {                                                                         \
            const type_of_model value = values[k] converted;                                                          \
            good = instance_set(component, references[k], type, place value);                                         \
        }                                                                                                             \
        return status_of(good);                                                                                       \
    }

SET(Real, MODEL_REAL, double, , &)
SET(Integer, MODEL_INTEGER, int32_t, , &)
SET(Boolean, MODEL_BOOLEAN, bool, != 0, &)
SET(String, MODEL_TEXTUAL, char *, , )

/* ---- the state ---- */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    return status_of(instance_snapshot(component, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    return status_of(instance_load(component, state, instance_size()));
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    (void)component;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    (void)component;
    (void)state;
    *size = instance_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)component;
    if (size < instance_size()) {
        return fmi2Error;
    }
    memcpy(bytes, state, instance_size());
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return status_of(instance_unpack(component, bytes, size, state));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknowns[],
                                        size_t unknown_count, const fmi2ValueReference knowns[], size_t known_count,
                                        const fmi2Real seed[], fmi2Real moved[])
{
    return status_of(instance_derivative(component, unknowns, unknown_count, knowns, known_count, seed, moved));
}

/* ---- what these models have not ---- */

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define NONE(function, ...)                                                                                           \
    fmi2Status function(__VA_ARGS__)                                                                                  \
    {                                                                                                                 \
        return fmi2Error;                                                                                             \
    }

NONE(fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer o[],
     const fmi2Real v[])
NONE(fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer o[],
     fmi2Real v[])
NONE(fmi2CancelStep, fmi2Component c)
NONE(fmi2GetStatus, fmi2Component c, const fmi2StatusKind s, fmi2Status *v)
NONE(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind s, fmi2Real *v)
NONE(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind s, fmi2Integer *v)
NONE(fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind s, fmi2Boolean *v)
NONE(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind s, fmi2String *v)
