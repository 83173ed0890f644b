/* SDO requests through the client's slot: they never block. */
#include "internal.h"

#include <string.h>

int ecat_sdo_start(ecat_t *bus, int position, unsigned index, unsigned subindex, const void *data,
                   size_t length) {
  ecat_out_request *request;
  int code, cell;
  if (position < 0 || position >= ecat_slave_count(bus))
    return ecat_fail(bus, ECAT_EBUS, "bus '%s' has no slave %d: it has %d", bus->name, position,
                     ecat_slave_count(bus));
  if (index > 0xFFFF || subindex > 0xFF)
    return ecat_fail(bus, ECAT_EARG, "0x%04X:%02X is no object: index up to 0xFFFF, subindex up to 0xFF",
                     index, subindex);
  if (data != NULL && (length == 0 || length > ECAT_REQUEST_BYTES))
    return ecat_fail(bus, ECAT_EARG, "%zu bytes cannot be downloaded: 1 to %d are allowed", length,
                     ECAT_REQUEST_BYTES);
  if ((code = ecat_slot_take(bus)) != 0) return code;
  for (cell = 0; cell < ECAT_REQUESTS && bus->request[cell] != 0; cell++) continue;
  if (cell == ECAT_REQUESTS)
    return ecat_fail(bus, ECAT_EFULL, "%d requests are running already; poll one to its end first",
                     ECAT_REQUESTS);
  request = (ecat_out_request *)(void *)(bus->out + 1) + cell;
  bus->request[cell] = ++bus->request_seq;
  request->op = data != NULL ? ECAT_REQUEST_DOWNLOAD : ECAT_REQUEST_UPLOAD;
  request->slave = (uint16_t)position;
  request->index = (uint16_t)index;
  request->subindex = (uint8_t)subindex;
  request->complete = 0;
  request->length = data != NULL ? (uint32_t)length : 0;
  if (data != NULL) memcpy(request->data, data, length);
  __atomic_store_n(&request->seq, bus->request_seq, __ATOMIC_RELEASE);
  __atomic_store_n(&bus->doorbell->request_seq, bus->request_seq, __ATOMIC_RELEASE);
  return cell;
}

int ecat_sdo_poll(ecat_t *bus, int cell, void *data, size_t size, size_t *length,
                  uint32_t *abort_code) {
  const ecat_shm_reply *reply;
  char copy[ECAT_REQUEST_BYTES];
  uint64_t now, end;
  uint32_t reason;
  size_t bytes;
  int code, status;
  if (cell < 0 || cell >= ECAT_REQUESTS || bus->request[cell] == 0)
    return ecat_fail(bus, ECAT_EARG, "%d is no running request", cell);
  reply = &bus->replies[bus->slot * ECAT_REQUESTS + cell];
  if (__atomic_load_n(&reply->seq, __ATOMIC_ACQUIRE) != bus->request[cell] ||
      __atomic_load_n(&reply->generation, __ATOMIC_RELAXED) != bus->generation) {
    now = ecat_now();
    end = __atomic_load_n(&bus->header->cycle_end_ns, __ATOMIC_RELAXED);
    code = ecat_segment_check(bus, now > end ? now - end : 0);
    if (code == 0) return ECAT_EBUSY;
    bus->request[cell] = 0;
    return code;
  }
  bytes = reply->length <= ECAT_REQUEST_BYTES ? reply->length : ECAT_REQUEST_BYTES;
  status = reply->status;
  reason = reply->abort_code;
  memcpy(copy, reply->data, bytes);
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  if (__atomic_load_n(&reply->seq, __ATOMIC_RELAXED) != bus->request[cell])
    return ECAT_EBUSY; /* being written */
  bus->request[cell] = 0;
  if (length != NULL) *length = 0;
  if (abort_code != NULL) *abort_code = reason;
  if (status != 0) return ecat_fail(bus, status, "%.*s", (int)bytes, copy);
  if (length != NULL) *length = bytes;
  if (data != NULL) memcpy(data, copy, bytes < size ? bytes : size);
  return 0;
}
