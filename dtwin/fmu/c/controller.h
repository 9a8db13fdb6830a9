/* The controller alone: samples in, volts out, every tick. */
#ifndef DTWIN_CONTROLLER_H
#define DTWIN_CONTROLLER_H

#include "control.h"

struct model {
    double time;
    struct control control;
};

#endif
