/* Queues of frames with a fixed room. */
#include "bus.h"

int queue_make(struct queue *queue, unsigned capacity)
{
    queue->frames = calloc(capacity, sizeof *queue->frames);
    queue->capacity = capacity;
    queue->first = queue->count = 0;
    return queue->frames == NULL ? -ENOMEM : 0;
}

bool queue_push(struct queue *queue, const struct can_frame *frame)
{
    if (queue->count == queue->capacity)
        return false;
    queue->frames[(queue->first + queue->count++) % queue->capacity] = *frame;
    return true;
}

void queue_pop(struct queue *queue)
{
    queue->first = (queue->first + 1) % queue->capacity;
    queue->count--;
}
