/* The arm under its controller. */
#ifndef DTWIN_CELL_H
#define DTWIN_CELL_H

#include "arm.h"
#include "control.h"

struct model {
    double time;
    double box_mass; /* of the box that waits */
    struct control control;
    struct arm arm;
};

#endif
