/* Reads a bus over Zenoh: over_zenoh ENDPOINT, by default tcp/127.0.0.1:7447, the daemon of this machine.
 * From another machine it needs a daemon with gateway.anonymous_reading and an address in
 * gateway.listen that the network reaches, such as tcp/cell4:7447, or a Zenoh library with TLS and the
 * identity of a user (docs/zenoh.md).
 *
 * It finds the buses in reach, reads the vendor ID of slave 0 of the first one (object 0x1018:01), and
 * prints three values as they come. Libraries: zenoh-pico 1.9 and msgpack-c.
 *
 *   cc -DZENOH_LINUX over_zenoh.c -o over_zenoh $(pkg-config --cflags --libs zenohpico msgpack)
 */
#include <msgpack.h>
#include <stdio.h>
#include <string.h>
#include <zenoh-pico.h>

enum { KEY_SIZE = 128, SHOWN = 3 };

/* Prints one field of the map that each payload of ecatd is. */
static void print_field(const z_loaned_bytes_t *payload, const char *name) {
  z_owned_slice_t bytes;
  msgpack_unpacked map;
  if (z_bytes_to_slice(payload, &bytes) != Z_OK) return;
  msgpack_unpacked_init(&map);
  if (msgpack_unpack_next(&map, (const char *)z_slice_data(z_loan(bytes)), z_slice_len(z_loan(bytes)),
                          NULL) == MSGPACK_UNPACK_SUCCESS &&
      map.data.type == MSGPACK_OBJECT_MAP) {
    for (uint32_t i = 0; i < map.data.via.map.size; i++) {
      const msgpack_object_kv *field = &map.data.via.map.ptr[i];
      if (field->key.type == MSGPACK_OBJECT_STR && field->key.via.str.size == strlen(name) &&
          memcmp(field->key.via.str.ptr, name, strlen(name)) == 0) {
        printf("  %s: ", name);
        msgpack_object_print(stdout, field->val);
        printf("\n");
      }
    }
  }
  msgpack_unpacked_destroy(&map);
  z_drop(z_move(bytes));
}

/* Sends a query, and prints a field of each answer. */
static void ask(const z_loaned_session_t *session, const char *key, const char *field) {
  z_owned_closure_reply_t closure;
  z_owned_fifo_handler_reply_t answers;
  z_owned_reply_t reply;
  z_view_keyexpr_t name;
  printf("%s\n", key);
  z_view_keyexpr_from_str_unchecked(&name, key);
  z_fifo_channel_reply_new(&closure, &answers, 16);
  if (z_get(session, z_loan(name), "", z_move(closure), NULL) == Z_OK) {
    while (z_recv(z_loan(answers), &reply) == Z_OK) {
      if (z_reply_is_ok(z_loan(reply))) {
        print_field(z_sample_payload(z_reply_ok(z_loan(reply))), field);
      } else {
        print_field(z_reply_err_payload(z_reply_err(z_loan(reply))), "error");
      }
      z_drop(z_move(reply));
    }
  }
  z_drop(z_move(answers));
}

/* Finds the buses in reach, prints their keys, and copies the beginning of the first one. */
static void find(const z_loaned_session_t *session, char first[KEY_SIZE]) {
  z_owned_closure_reply_t closure;
  z_owned_fifo_handler_reply_t answers;
  z_owned_reply_t reply;
  z_view_keyexpr_t name;
  z_view_string_t key;
  z_view_keyexpr_from_str_unchecked(&name, "ecat/v1/*/alive");
  z_fifo_channel_reply_new(&closure, &answers, 16);
  if (z_liveliness_get(session, z_loan(name), z_move(closure), NULL) == Z_OK) {
    while (z_recv(z_loan(answers), &reply) == Z_OK) {
      if (z_reply_is_ok(z_loan(reply))) {
        z_keyexpr_as_view_string(z_sample_keyexpr(z_reply_ok(z_loan(reply))), &key);
        int length = (int)z_string_len(z_loan(key)) - (int)strlen("/alive");
        printf("bus %.*s\n", length, z_string_data(z_loan(key)));
        if (!first[0]) snprintf(first, KEY_SIZE, "%.*s", length, z_string_data(z_loan(key)));
      }
      z_drop(z_move(reply));
    }
  }
  z_drop(z_move(answers));
}

/* Prints values of the process data as they are published. */
static void watch(const z_loaned_session_t *session, const char *key) {
  z_owned_closure_sample_t closure;
  z_owned_fifo_handler_sample_t samples;
  z_owned_subscriber_t subscriber;
  z_owned_sample_t sample;
  z_view_keyexpr_t name;
  z_view_string_t place;
  z_view_keyexpr_from_str_unchecked(&name, key);
  z_fifo_channel_sample_new(&closure, &samples, 64);
  if (z_declare_subscriber(session, &subscriber, z_loan(name), z_move(closure), NULL) != Z_OK) return;
  for (int i = 0; i < SHOWN && z_recv(z_loan(samples), &sample) == Z_OK; i++) {
    z_keyexpr_as_view_string(z_sample_keyexpr(z_loan(sample)), &place);
    printf("%.*s\n", (int)z_string_len(z_loan(place)), z_string_data(z_loan(place)));
    print_field(z_sample_payload(z_loan(sample)), "value");
    z_drop(z_move(sample));
  }
  z_drop(z_move(subscriber));
  z_drop(z_move(samples));
}

int main(int argc, char **argv) {
  z_owned_config_t config;
  z_owned_session_t session;
  char bus[KEY_SIZE] = "", key[KEY_SIZE + 64];
  z_config_default(&config);
  zp_config_insert(z_loan_mut(config), Z_CONFIG_MODE_KEY, "client");
  zp_config_insert(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, argc > 1 ? argv[1] : "tcp/127.0.0.1:7447");
  if (z_open(&session, z_move(config), NULL) != Z_OK) {
    fprintf(stderr, "no Zenoh endpoint answers at this address\n");
    return 4;
  }
  find(z_loan(session), bus);
  if (bus[0]) {
    snprintf(key, sizeof key, "%s/ro/sdo/0/0x1018/1", bus);
    ask(z_loan(session), key, "data");
    snprintf(key, sizeof key, "%s/ro/pdo/**", bus);
    watch(z_loan(session), key);
  }
  z_drop(z_move(session));
  return bus[0] ? 0 : 4;
}
