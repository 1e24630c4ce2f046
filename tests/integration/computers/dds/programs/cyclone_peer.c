/* A participant on the C library of Cyclone DDS: `cyclone_peer NAME DOMAIN` says what it hears, until it is stopped.
   Lines: `SECONDS peer + KEY`, `SECONDS peer - KEY`, `SECONDS got FROM NUMBER`; seconds of CLOCK_MONOTONIC. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "dds/dds.h"
#include "proof.h"

static double now(void) {
  struct timespec at;
  clock_gettime(CLOCK_MONOTONIC, &at);
  return (double)at.tv_sec + (double)at.tv_nsec / 1e9;
}

static void stop_unless(bool well, const char *what) {
  if (!well) {
    fprintf(stderr, "%s failed\n", what);
    exit(1);
  }
}

static void take_peers(dds_entity_t reader) {
  void *samples[16] = {NULL};
  dds_sample_info_t infos[16];
  int count = dds_take(reader, samples, infos, 16, 16);
  for (int i = 0; i < count; i++) {
    const dds_builtintopic_participant_t *one = samples[i];
    printf("%.3f peer %c ", now(), infos[i].instance_state == DDS_IST_ALIVE ? '+' : '-');
    for (int byte = 0; byte < 16; byte++) printf("%02x", one->key.v[byte]);
    printf("\n");
  }
  if (count > 0) dds_return_loan(reader, samples, count);
}

static void take_words(dds_entity_t reader, const char *own) {
  void *samples[16] = {NULL};
  dds_sample_info_t infos[16];
  int count = dds_take(reader, samples, infos, 16, 16);
  for (int i = 0; i < count; i++) {
    const std_msgs_msg_dds__String_ *word = samples[i];
    if (infos[i].valid_data && strncmp(word->data, own, strlen(own)) != 0) printf("%.3f got %s\n", now(), word->data);
  }
  if (count > 0) dds_return_loan(reader, samples, count);
}

int main(int argc, char **argv) {
  stop_unless(argc == 3, "reading the arguments NAME DOMAIN");
  setvbuf(stdout, NULL, _IOLBF, 0);
  dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(argv[2]), NULL, NULL);
  stop_unless(participant > 0, "making the participant");
  dds_qos_t *qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 16); /* its own words come back too */
  dds_entity_t topic = dds_create_topic(participant, &std_msgs_msg_dds__String__desc, "rt/proof", NULL, NULL);
  dds_entity_t writer = dds_create_writer(participant, topic, qos, NULL);
  dds_entity_t reader = dds_create_reader(participant, topic, qos, NULL);
  dds_entity_t peers = dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, NULL, NULL);
  stop_unless(topic > 0 && writer > 0 && reader > 0 && peers > 0, "making topic, writer and readers");
  for (unsigned number = 1;; number++) {
    char text[64];
    snprintf(text, sizeof text, "%.32s %u", argv[1], number);
    std_msgs_msg_dds__String_ word = {.data = text};
    stop_unless(dds_write(writer, &word) == DDS_RETCODE_OK, "writing");
    take_peers(peers);
    take_words(reader, argv[1]);
    dds_sleepfor(DDS_MSECS(500));
  }
}
