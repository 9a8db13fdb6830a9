#include "control.h"

#include <string.h>

#include "constants.h"

static const char *const problems[] = {
    "",
    "a function block failed: an index is out of range",
    "a function block failed: a loop does not end",
    "a function block failed: BY 0 never ends",
    "a function block failed: a text is too long",
    "a function block failed: a chart never comes to rest",
    "the function blocks failed: endless loop of events",
    "the function blocks failed: too many events wait",
    "the function blocks are not initialised",
    "the function blocks did not answer a sample once",
};

void control_reset(struct control *control)
{
    memset(control, 0, sizeof *control);
    program__initialise(&control->program);
    control->program.EMULATOR.attached__ = true;
}

static const char *told(int32_t problem)
{
    return problem == FB_FINE ? NULL : problems[problem];
}

const char *control_begin(struct control *control, double time)
{
    control->first = time;
    control->ticks = 0;
    return told(program__cold(&control->program));
}

double control_due(const struct control *control)
{
    return control->first + (double)control->ticks * PERIOD;
}

const char *control_tick(struct control *control)
{
    struct program__EMULATOR__request request = {0};
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
    ++control->ticks;
    return told(problem);
}
