#include "control.h"

#include <math.h>
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
    "a function block failed: a character is not in the text",
};

#define QUEUE offsetof(struct control, program.run.queue)
#define BEHIND_QUEUE (QUEUE + sizeof((struct control *)NULL)->program.run.queue)

void control_copy(struct control *to, const struct control *from)
{
    memcpy(to, from, QUEUE);
    memcpy((char *)to + BEHIND_QUEUE, (const char *)from + BEHIND_QUEUE, sizeof *to - BEHIND_QUEUE);
}

void control_reset(struct control *control)
{
    memset(control, 0, sizeof *control);
    program__initialise(&control->program);
    control_attach(control);
}

const char *control_problem(int32_t problem)
{
    const bool is_known = problem > 0 && (size_t)problem < sizeof problems / sizeof problems[0];
    return problem == FB_FINE ? NULL : is_known ? problems[problem] : "a function block failed";
}

const char *control_begin(struct control *control)
{
    control->wait = 0.0;
    return control_problem(program__cold(&control->program));
}

/* The clock counts whole periods from tick to tick, so that no sum of times has to be told from a whole number. */
double control_wait(const struct control *control, double rounding)
{
    return fabs(control->wait) <= CLOCK_ROUNDING + rounding ? 0.0 : control->wait;
}

int64_t control_pass(struct control *control, double duration, double rounding)
{
    const double ticks = ceil((duration - control->wait - CLOCK_ROUNDING - rounding) / PERIOD);
    const double due = ticks > 0.0 ? ticks : 0.0;
    control->wait = (control->wait - duration) + due * PERIOD;
    return (int64_t)due;
}

bool control_is_sound(const struct control *control)
{
    const char *bytes = (const char *)&control->program;
    struct fb_string text;
    size_t k;
    for (k = 0; k < program__count; ++k) {
        if (strcmp(program__variables[k].type, "STRING") == 0) {
            memcpy(&text.length, bytes + program__variables[k].offset, sizeof text.length);
            if (text.length > FB_TEXT) {
                return false;
            }
        }
    }
    return control->program.run.head < FB_WAITING && control->program.run.waiting == 0 && isfinite(control->wait) &&
           fabs(control->wait) <= 2.0 * PERIOD;
}
