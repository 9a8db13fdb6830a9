/* The control application of an arm, its function blocks as machine code, with its clock. */
#ifndef DTWIN_CONTROL_H
#define DTWIN_CONTROL_H

#include "control_state.h"

/* Connects the block that talks with the arm. */
void control_attach(struct control *control);

/* What went wrong, or a null pointer. */
const char *control_problem(int32_t problem);

/* Copies all but the queue of events, which is empty between two calls. */
void control_copy(struct control *to, const struct control *from);

/* Puts the blocks to their beginning. */
void control_reset(struct control *control);

/* Starts the blocks; the first tick is due at once. Returns what is wrong, or a null pointer. */
const char *control_begin(struct control *control);

/* The time until the next tick is due; none where it is within a rounding of the present. */
double control_wait(const struct control *control, double rounding);

/* Moves the clock on by a duration, a tick that is due at its end being one of what follows. Returns the number of ticks
 * in it. */
int64_t control_pass(struct control *control, double duration, double rounding);

/* Lets the blocks answer the sample. Returns what is wrong, or a null pointer. */
const char *control_tick(struct control *control);

/* Whether texts and queues are within their places; for bytes that come from somewhere. */
bool control_is_sound(const struct control *control);

#endif
