/* What a block type in C tells a 4diac FORTE that has it built in. */
#ifndef DTWIN_TYPES_H
#define DTWIN_TYPES_H

#include "fb.h"

/* An event: its name and type, and the numbers of the data WITH it, ended by -1; NULL if there are none. */
struct dtwin_event {
    const char *name;
    const char *type;
    const int16_t *with;
};

/* A variable: its name, the name of its type or its elements' type, and where it is in the state of a block. */
struct dtwin_data {
    const char *name;
    const char *type;
    size_t offset;
    uint16_t length; /* of an array; 0 for a variable that is none */
    int16_t lower;   /* bound of an array */
};

struct dtwin_type {
    const char *name;
    size_t size;         /* of the state of a block, in bytes */
    const void *initial; /* the state of a block at its beginning */
    size_t chart;        /* where the number of the chart's state is, an int32_t; `size` when there is no chart */
    const struct dtwin_event *event_inputs, *event_outputs;
    const struct dtwin_data *inputs, *outputs, *internals;
    uint16_t event_input_count, event_output_count, input_count, output_count, internal_count;
    void (*execute)(void *state, struct fb_run *run, uint16_t event);
    const struct fb_place *places;
};

/* One execution of a block: `issue` is called for every event that it issues, by the number of the output. */
struct dtwin_execution {
    struct fb_run run; /* the first member, by which the functions of a block know it */
    void *block;
    void (*issue)(void *block, uint16_t output);
};

static inline void fb_issue(struct fb_run *run, int32_t output)
{
    struct dtwin_execution *execution = (struct dtwin_execution *)run;
    execution->issue(execution->block, (uint16_t)output);
}

#endif
