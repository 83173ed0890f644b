/* Programs: devices in C that have their process data to themselves.
 *
 * The program of a slave makes a cycle after each frame that has written its outputs, as a device
 * that is synchronous with its sync manager does. The frame does not wait for it. If no outputs
 * come, the device side lets the program run at its own rate.
 */
#include "slave.h"

#include <errno.h>
#include <stdlib.h>

/* The process data of a slave, all its areas of a direction one behind the other. */
struct program {
    esc_program_function function;
    void *context;
    bool ran; /* since the device side looked last */
    uint8_t outputs[ESC_MAX_PROGRAM_DATA], inputs[ESC_MAX_PROGRAM_DATA];
};

int esc_set_program(struct esc_segment *segment, int position, esc_program_function function,
                    void *context)
{
    struct program *program = NULL, *before = NULL;
    int result = -ENODEV;
    if (function != NULL && (program = calloc(1, sizeof *program)) == NULL)
        return -ENOMEM;
    pthread_mutex_lock(&segment->lock);
    if (position >= 0 && (unsigned)position < segment->count) {
        struct slave *slave = segment->slaves[position];
        if (program != NULL) {
            program->function = function;
            program->context = context;
        }
        before = slave->program;
        slave->program = program;
        slave->program_due = false;
        result = 0;
    } else {
        before = program;
    }
    pthread_mutex_unlock(&segment->lock);
    free(before);
    return result;
}

void program_remove(struct slave *slave)
{
    free(slave->program);
    slave->program = NULL;
    slave->program_due = false;
}

static size_t size_of(const struct slave *slave, bool output)
{
    size_t size = 0;
    for (unsigned i = 0; i < slave->area_count; i++)
        if ((slave->areas[i].output != 0) == output)
            size += slave->areas[i].size;
    return size;
}

/* Reads all output areas; those whose one buffer is empty keep the last outputs. */
static void read_outputs(struct slave *slave, uint8_t *data)
{
    for (unsigned i = 0; i < slave->area_count; i++) {
        const struct esc_area *area = &slave->areas[i];
        if (area->output == 0)
            continue;
        if (buffers_turn(slave, area))
            buffers_read(slave, area->address, (uint32_t)area->address + area->size, data);
        data += area->size;
    }
}

static void write_inputs(struct slave *slave, const uint8_t *data)
{
    for (unsigned i = 0; i < slave->area_count; i++) {
        const struct esc_area *area = &slave->areas[i];
        if (area->output != 0)
            continue;
        if (buffers_turn(slave, area))
            (void)buffers_write(slave, area->address, (uint32_t)area->address + area->size, data);
        data += area->size;
    }
}

static void run(struct slave *slave, int64_t now_ns)
{
    struct program *program = slave->program;
    size_t output_size = size_of(slave, true), input_size = size_of(slave, false);
    if (output_size > sizeof program->outputs || input_size > sizeof program->inputs)
        return; /* the device refuses these sizes before it comes so far */
    read_outputs(slave, program->outputs);
    program->function(program->context, now_ns, pdi_outputs_count(slave) ? program->outputs : NULL,
                      output_size, program->inputs, input_size);
    write_inputs(slave, program->inputs);
}

/* Runs the programs whose outputs have come. Called with the lock held, after a frame. */
void program_run_due(struct esc_segment *segment)
{
    segment->programs_due = false;
    for (unsigned i = 0; i < segment->count; i++) {
        struct slave *slave = segment->slaves[i];
        if (!slave->program_due)
            continue;
        slave->program_due = false;
        slave->program->ran = true;
        run(slave, frame_time_ns(segment));
    }
}

/* Runs the program of a slave if it has not run since the last call. */
void program_run_idle(struct slave *slave, int64_t now_ns)
{
    if (!slave->program->ran && slave->area_count > 0)
        run(slave, now_ns);
    slave->program->ran = false;
}

/* Has the program begin with inputs of zeros, as at power-on. */
void program_clear(struct slave *slave)
{
    if (slave->program == NULL)
        return;
    memset(slave->program->inputs, 0, sizeof slave->program->inputs);
    memset(slave->program->outputs, 0, sizeof slave->program->outputs);
}
