#include <math.h>
#include <string.h>

#include "control.h"

void control_attach(struct control *control)
{
    control->program.EMULATOR.attached__ = true;
}

const char *control_tick(struct control *control)
{
    struct program__EMULATOR__request request;
    struct program__EMULATOR__answer answer = {0};
    const size_t length = strlen(control->box_colour);
    int32_t problem;
    request.RD_1 = control->theta[0];
    request.RD_2 = control->theta[1];
    request.RD_3 = control->theta[2];
    request.RD_4 = control->gripper;
    request.RD_5 = control->box_present;
    request.RD_6.length = (uint16_t)length;
    memcpy(request.RD_6.text, control->box_colour, length);
    problem = program__exchange__EMULATOR(&control->program, &request, &answer);
    control->volts[0] = answer.SD_1;
    control->volts[1] = answer.SD_2;
    control->volts[2] = answer.SD_3;
    control->volts[3] = answer.SD_4;
    control->box_gripped = answer.SD_5;
    if (problem == FB_FINE && !(isfinite(answer.SD_1) && isfinite(answer.SD_2) && isfinite(answer.SD_3))) {
        return "the function blocks answered with a voltage that is not finite";
    }
    return control_problem(problem);
}
