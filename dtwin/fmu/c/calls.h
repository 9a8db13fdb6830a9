/* The functions of FMI by what they do, and the states in which they may be called. */
#ifndef DTWIN_CALLS_H
#define DTWIN_CALLS_H

#include <stdbool.h>

/* The states of an instance. MODE_FAILED is "error" of FMI 2.0; FMI 3.0 has Terminated instead. */
enum mode {
    MODE_INSTANTIATED = 1,
    MODE_INITIALIZING = 2,
    MODE_EVENT = 4,
    MODE_STEPPING = 8,
    MODE_TERMINATED = 16,
    MODE_FAILED = 32
};

enum call {
    CALL_SET_DEBUG_LOGGING,
    CALL_SETUP_EXPERIMENT,
    CALL_ENTER_INITIALIZATION_MODE,
    CALL_EXIT_INITIALIZATION_MODE,
    CALL_TERMINATE,
    CALL_RESET,
    CALL_GET,
    CALL_SET,
    CALL_STATE,
    CALL_GET_DIRECTIONAL_DERIVATIVE,
    CALL_DO_STEP,
    CALL_GET_STATUS,
    CALL_ENTER_EVENT_MODE,
    CALL_EVENT_ITERATION,
    CALL_ENTER_STEP_MODE,
    CALL_NEVER
};

/* Whether a function of FMI 2 or FMI 3 may be called in a state. */
bool call_is_allowed(enum call call, int version, enum mode mode);

/* A state in words. */
const char *mode_name(enum mode mode);

#endif
