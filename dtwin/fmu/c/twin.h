/* The analytic twin alone: volts in, angles out. */
#ifndef DTWIN_TWIN_H
#define DTWIN_TWIN_H

#include "arm.h"

struct model {
    double time;
    struct arm arm;
};

#endif
