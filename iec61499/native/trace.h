/* Records of events in the Common Trace Format, as iec61499.trace writes them. */

/* Where records go: `flush` empties the buffer. */
struct fb_trace {
    void (*flush)(void);
    uint8_t *buffer;
    uint64_t size;
    uint64_t used;
    uint64_t records;
    int64_t time;          /* of the resource, ns */
    const uint16_t *kinds; /* the number of the kind of each event */
};

/* A variable whose value is in a record. */
struct fb_piece {
    uint32_t offset;
    uint16_t size;
    uint16_t form; /* 0: its bytes, 1: a text, 2: the state of a chart */
};

/* What is recorded of an entry of the queue: the number of the event, 0 for none, and its pieces. */
struct fb_traced {
    uint16_t event;
    uint16_t first;
    uint16_t count;
};

/* A text in UTF-8 of characters from the bytes of a STRING, with an end mark. */
static uint8_t *fb_record_text(uint8_t *to, const struct fb_string *text)
{
    uint16_t k;
    for (k = 0; k < text->length; ++k) {
        const uint8_t byte = (uint8_t)text->text[k];
        if (byte == '\\' || byte == 0) {
            *to++ = '\\';
            *to++ = byte == 0 ? '0' : byte;
        } else if (byte < 0x80) {
            *to++ = byte;
        } else {
            *to++ = (uint8_t)(0xC0 | byte >> 6);
            *to++ = (uint8_t)(0x80 | (byte & 0x3F));
        }
    }
    *to++ = 0;
    return to;
}

static void fb_record(struct fb_trace *trace, const void *unit, const struct fb_traced *what,
                      const struct fb_piece *pieces, uint64_t longest)
{
    uint8_t *to;
    uint16_t k;
    if (trace == NULL || what->event == 0) {
        return;
    }
    if (trace->size - trace->used < longest) {
        trace->flush();
    }
    to = trace->buffer + trace->used;
    memcpy(to, &trace->kinds[what->event - 1], 2);
    memcpy(to + 2, &trace->time, 8);
    to += 10;
    for (k = what->first; k < what->first + what->count; ++k) {
        const uint8_t *from = (const uint8_t *)unit + pieces[k].offset;
        if (pieces[k].form == 0 && pieces[k].size == 8) {
            memcpy(to, from, 8);
            to += 8;
        } else if (pieces[k].form == 0) {
            memcpy(to, from, pieces[k].size);
            to += pieces[k].size;
        } else if (pieces[k].form == 1) {
            to = fb_record_text(to, (const struct fb_string *)(const void *)from);
        } else {
            int32_t state;
            uint16_t number;
            memcpy(&state, from, 4);
            number = (uint16_t)state;
            memcpy(to, &number, 2);
            to += 2;
        }
    }
    trace->used = (uint64_t)(to - trace->buffer);
    ++trace->records;
}
