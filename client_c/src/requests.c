/* Requests to the daemon through the client's slot. Only ecat_wait_request() blocks. */
#include "internal.h"

#include <string.h>

/* Takes a free cell for a request and fills in all fields except its object and data. Sets `*cell` to the
 * number of the cell. Returns NULL on failure, with the error code in `*cell`. */
static ecat_out_request *take(ecat_t *bus, int position, uint32_t op, int *cell) {
  ecat_out_request *request;
  int free_one = 0;
  if ((*cell = ecat_slot_take(bus)) != 0) return NULL;
  while (free_one < ECAT_REQUESTS && (bus->request[free_one] != 0 || bus->ended[free_one])) free_one++;
  if (free_one == ECAT_REQUESTS) /* a request that ended with the daemon need not be polled */
    for (free_one = 0; free_one < ECAT_REQUESTS && bus->request[free_one] != 0;) free_one++;
  if (free_one == ECAT_REQUESTS) {
    *cell = ecat_fail(bus, ECAT_EFULL, "%d requests are running already; poll one to its end first",
                      ECAT_REQUESTS);
    return NULL;
  }
  *cell = free_one;
  request = (ecat_out_request *)(void *)(bus->out + 1) + free_one;
  /* The daemon may still read the last request of this cell. It compares the number again before it acts,
   * so the number is cleared before any byte of the new request is written. */
  __atomic_store_n(&request->seq, 0, __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_RELEASE);
  request->op = op;
  request->slave = (uint16_t)position;
  request->index = 0;
  request->subindex = request->complete = 0;
  request->length = 0;
  return request;
}

static int ring(ecat_t *bus, ecat_out_request *request, int cell) {
  bus->ended[cell] = 0;
  bus->handle[cell] = (int)(++bus->handles & 0xFFFFFF) * ECAT_REQUESTS + cell;
  if (++bus->request_seq == 0) bus->request_seq = 1; /* 0: empty */
  bus->request[cell] = bus->request_seq;
  __atomic_store_n(&request->seq, bus->request_seq, __ATOMIC_RELEASE);
  __atomic_store_n(&bus->doorbell->request_seq, bus->request_seq, __ATOMIC_RELEASE);
  return bus->handle[cell];
}

int ecat_sdo_start(ecat_t *bus, int position, unsigned index, unsigned subindex, const void *data,
                   size_t length) {
  ecat_out_request *request;
  int cell, code = ecat_check_position(bus, position);
  if (code != 0) return code;
  if (index > 0xFFFF || subindex > 0xFF)
    return ecat_fail(bus, ECAT_EARG, "0x%04X:%02X is no object: index up to 0xFFFF, subindex up to 0xFF",
                     index, subindex);
  if (data != NULL && (length == 0 || length > ECAT_REQUEST_BYTES))
    return ecat_fail(bus, ECAT_EARG, "%zu bytes cannot be downloaded: 1 to %d are allowed", length,
                     ECAT_REQUEST_BYTES);
  request = take(bus, position, data != NULL ? ECAT_REQUEST_DOWNLOAD : ECAT_REQUEST_UPLOAD, &cell);
  if (request == NULL) return cell;
  request->index = (uint16_t)index;
  request->subindex = (uint8_t)subindex;
  if (data != NULL) {
    request->length = (uint32_t)length;
    memcpy(request->data, data, length);
  }
  return ring(bus, request, cell);
}

int ecat_state_start(ecat_t *bus, int position, unsigned state) {
  ecat_out_request *request;
  int cell, code = ecat_check_position(bus, position);
  if (code != 0) return code;
  if (state != 1 && state != 2 && state != 4 && state != 8)
    return ecat_fail(bus, ECAT_EARG, "%u is no AL state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP", state);
  if ((request = take(bus, position, ECAT_REQUEST_STATE, &cell)) == NULL) return cell;
  request->length = 1;
  request->data[0] = (char)state;
  return ring(bus, request, cell);
}

/* The cell of a running or ended request, or an error code. */
static int cell_of(ecat_t *bus, int handle) {
  int cell = handle % ECAT_REQUESTS;
  if (handle >= 0 && bus->handle[cell] == handle && (bus->request[cell] != 0 || bus->ended[cell]))
    return cell;
  return ecat_fail(bus, ECAT_EARG, "%d is no running request: it was asked for to its end, or has "
                   "ended with the claims of this client", handle);
}

static const ecat_shm_reply *reply_to(const ecat_t *bus, int cell) {
  return &bus->replies[bus->slot * ECAT_REQUESTS + cell];
}

static int is_answered(const ecat_t *bus, int cell) {
  const ecat_shm_reply *reply = reply_to(bus, cell);
  return __atomic_load_n(&reply->seq, __ATOMIC_ACQUIRE) == bus->request[cell] &&
         __atomic_load_n(&reply->generation, __ATOMIC_RELAXED) == bus->generation;
}

int ecat_poll(ecat_t *bus, int handle, void *data, size_t size, size_t *length,
              uint32_t *abort_code) {
  const ecat_shm_reply *reply;
  char copy[ECAT_REQUEST_BYTES];
  uint32_t reason;
  size_t bytes;
  int code, status, cell = cell_of(bus, handle);
  if (cell < 0) return cell;
  if (bus->ended[cell]) {
    bus->ended[cell] = 0;
    return ecat_fail(bus, ECAT_EDOWN, "the request has ended with the daemon of bus '%s'; whether it "
                     "was carried out is not known", bus->name);
  }
  if (!is_answered(bus, cell)) {
    code = ecat_memory_age(bus);
    if (code == 0 && !ecat_slot_overwritten(bus)) return ECAT_EBUSY;
    if (code == 0)
      code = ecat_fail(bus, ECAT_ELAYOUT,
                       "the request has ended: another program has written over the place of this "
                       "client in the shared memory of bus '%s'; start it again", bus->name);
    bus->request[cell] = bus->ended[cell] = 0;
    return code;
  }
  reply = reply_to(bus, cell);
  bytes = reply->length <= ECAT_REQUEST_BYTES ? reply->length : ECAT_REQUEST_BYTES;
  status = reply->status;
  reason = reply->abort_code;
  memcpy(copy, reply->data, bytes);
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  if (__atomic_load_n(&reply->seq, __ATOMIC_RELAXED) != bus->request[cell])
    return ECAT_EBUSY; /* the daemon is writing the reply */
  bus->request[cell] = 0;
  if (length != NULL) *length = 0;
  if (abort_code != NULL) *abort_code = reason;
  if (status != 0) return ecat_fail(bus, status, "%.*s", (int)bytes, copy);
  if (length != NULL) *length = bytes;
  if (data != NULL) memcpy(data, copy, bytes < size ? bytes : size);
  return 0;
}

int ecat_wait_request(ecat_t *bus, int handle, double timeout) {
  uint64_t start = ecat_now(), limit = ecat_ns(timeout);
  int code = 0, cell = cell_of(bus, handle);
  if (cell < 0) return cell;
  while (code == 0 && !bus->ended[cell] && !is_answered(bus, cell) && !ecat_slot_overwritten(bus)) {
    uint64_t passed = ecat_now() - start;
    if (passed >= limit)
      return ecat_fail(bus, ECAT_ETIMEOUT, "bus '%s': the request was not answered within %g s",
                       bus->name, timeout);
    code = ecat_wait_until(bus, &bus->header->cycle, ecat_cycle(bus) + 1, ECAT_WAKE_CYCLE,
                           (double)(limit - passed) * 1e-9);
    if (code == ECAT_ETIMEOUT || bus->ended[cell]) code = 0; /* left to ecat_poll() */
  }
  return code;
}

int ecat_cancel(ecat_t *bus, int handle) {
  ecat_out_request *request;
  int code, cell = cell_of(bus, handle);
  if (cell < 0 || (code = ecat_slot_check_home(bus)) != 0) return cell < 0 ? cell : code;
  if (!bus->ended[cell]) {
    request = (ecat_out_request *)(void *)(bus->out + 1) + cell;
    __atomic_store_n(&request->seq, 0, __ATOMIC_RELEASE); /* dropped, if not read yet */
  }
  bus->request[cell] = bus->ended[cell] = 0;
  return 0;
}
