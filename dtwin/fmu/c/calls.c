#include "calls.h"

enum {
    INSTANTIATED = MODE_INSTANTIATED,
    INITIALIZING = MODE_INITIALIZING,
    EVENT = MODE_EVENT,
    STEPPING = MODE_STEPPING,
    TERMINATED = MODE_TERMINATED,
    FAILED = MODE_FAILED,
    NONE = 0,
    ALL = INSTANTIATED | INITIALIZING | EVENT | STEPPING | TERMINATED | FAILED
};

/* FMI 2.0.4: the table of section 4.2.4, whose column stepComplete is STEPPING; these models know neither stepInProgress,
 * stepFailed and stepCanceled nor fatal. FMI 3.0.2: "Allowed Function Calls" of the states in sections 2.3 and 4.2.1. */
static const struct {
    int fmi2, fmi3;
} allowed[] = {
    [CALL_SET_DEBUG_LOGGING] = {ALL, ALL},
    [CALL_SETUP_EXPERIMENT] = {INSTANTIATED, NONE},
    [CALL_ENTER_INITIALIZATION_MODE] = {INSTANTIATED, INSTANTIATED},
    [CALL_EXIT_INITIALIZATION_MODE] = {INITIALIZING, INITIALIZING},
    [CALL_TERMINATE] = {STEPPING, EVENT | STEPPING},
    [CALL_RESET] = {ALL, ALL},
    [CALL_GET] = {INITIALIZING | STEPPING | TERMINATED | FAILED, ALL},
    [CALL_SET] = {INSTANTIATED | INITIALIZING | STEPPING, INSTANTIATED | INITIALIZING | EVENT | STEPPING},
    [CALL_STATE] = {ALL, ALL},
    [CALL_GET_DIRECTIONAL_DERIVATIVE] = {INITIALIZING | STEPPING | TERMINATED | FAILED,
                                         INITIALIZING | EVENT | STEPPING | TERMINATED},
    [CALL_DO_STEP] = {STEPPING, STEPPING},
    [CALL_GET_STATUS] = {STEPPING | TERMINATED, NONE},
    [CALL_ENTER_EVENT_MODE] = {NONE, STEPPING},
    [CALL_EVENT_ITERATION] = {NONE, EVENT},
    [CALL_ENTER_STEP_MODE] = {NONE, EVENT},
    [CALL_NEVER] = {NONE, NONE},
};

bool call_is_allowed(enum call call, int version, enum mode mode)
{
    return ((version == 2 ? allowed[call].fmi2 : allowed[call].fmi3) & (int)mode) != 0;
}

const char *mode_name(enum mode mode)
{
    switch (mode) {
    case MODE_INSTANTIATED:
        return "before the initialization";
    case MODE_INITIALIZING:
        return "in the initialization";
    case MODE_EVENT:
        return "in event mode";
    case MODE_STEPPING:
        return "in step mode";
    case MODE_TERMINATED:
        return "after the end";
    case MODE_FAILED:
        return "after an error";
    }
    return "in no state of FMI";
}
