#include <math.h>

#include "control.h"
#include "messages.h"

void control_attach(struct control *control)
{
    control->program.ARM.attached__ = true;
}

const char *control_tick(struct control *control)
{
    struct program__ARM__request request;
    struct program__ARM__answer answer = {0};
    int32_t problem, i;
    set_request(&request, control->q, control->box);
    problem = program__exchange__ARM(&control->program, &request, &answer);
    control->box_gripped = get_answer(&answer, control->u);
    for (i = 0; i < JOINTS && problem == FB_FINE; ++i) {
        if (!isfinite(control->u[i])) {
            return "the function blocks answered with a command that is not finite";
        }
    }
    return control_problem(problem);
}
