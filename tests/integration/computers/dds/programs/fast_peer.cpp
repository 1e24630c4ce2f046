/* A participant on Fast DDS: `fast_peer NAME DOMAIN` says what it hears, until it is stopped.
   Lines: `SECONDS peer + KEY`, `SECONDS peer - KEY`, `SECONDS got FROM NUMBER`; seconds of CLOCK_MONOTONIC.
   Its profile comes from FASTRTPS_DEFAULT_PROFILES_FILE, as it does in a ROS node. */
#include <chrono>
#include <cstring>
#include <iostream>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::ParticipantDiscoveryInfo;
using eprosima::fastrtps::rtps::SerializedPayload_t;

static void say(const std::string& what) {
  static std::mutex one_at_a_time;
  std::lock_guard<std::mutex> hold(one_at_a_time);
  double now = std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  std::cout << std::fixed << now << " " << what << std::endl;
}

/* std_msgs/msg/String: a CDR header, the length with the closing zero, the characters. */
class Word : public TopicDataType {
 public:
  Word() {
    setName("std_msgs::msg::dds_::String_");
    m_typeSize = 256;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const std::string& text = *static_cast<std::string*>(data);
    uint32_t length = static_cast<uint32_t>(text.size() + 1);
    const unsigned char header[4] = {0, 1, 0, 0};
    std::memcpy(payload->data, header, 4);
    std::memcpy(payload->data + 4, &length, 4);
    std::memcpy(payload->data + 8, text.c_str(), length);
    payload->encapsulation = CDR_LE;
    payload->length = 8 + length;
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    uint32_t length = 0;
    if (payload->length < 9) return false;
    std::memcpy(&length, payload->data + 4, 4);
    if (length < 1 || 8 + length > payload->length) return false;
    static_cast<std::string*>(data)->assign(reinterpret_cast<char*>(payload->data) + 8, length - 1);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<std::string*>(data)->size() + 9); };
  }
  void* createData() override { return new std::string; }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

class Peers : public DomainParticipantListener {
 public:
  void on_participant_discovery(DomainParticipant*, ParticipantDiscoveryInfo&& info) override {
    std::ostringstream key;
    key << info.info.m_guid.guidPrefix;
    if (info.status == ParticipantDiscoveryInfo::DISCOVERED_PARTICIPANT) say("peer + " + key.str());
    if (info.status == ParticipantDiscoveryInfo::DROPPED_PARTICIPANT ||
        info.status == ParticipantDiscoveryInfo::REMOVED_PARTICIPANT)
      say("peer - " + key.str());
  }
};

static const auto stop_unless = [](bool well, const char* what) {
  if (!well) {
    std::cerr << what << " failed" << std::endl;
    std::exit(1);
  }
};

int main(int argc, char** argv) {
  stop_unless(argc == 3, "reading the arguments NAME DOMAIN");
  const std::string own = argv[1];
  auto* factory = DomainParticipantFactory::get_instance();
  stop_unless(factory->load_profiles() == ReturnCode_t::RETCODE_OK, "loading the profiles");
  Peers peers;
  auto* participant = factory->create_participant(std::stoi(argv[2]), factory->get_default_participant_qos(), &peers,
                                                  StatusMask::none());
  stop_unless(participant != nullptr, "making the participant");
  TypeSupport type(new Word);
  type.register_type(participant);
  auto* topic = participant->create_topic("rt/proof", type.get_type_name(), TOPIC_QOS_DEFAULT);
  DataWriterQos writing = DATAWRITER_QOS_DEFAULT;
  writing.reliability().kind = BEST_EFFORT_RELIABILITY_QOS;
  auto* writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, writing);
  DataReaderQos reading = DATAREADER_QOS_DEFAULT;
  reading.history().depth = 16;  // its own words come back too
  auto* reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, reading);
  stop_unless(writer != nullptr && reader != nullptr, "making writer and reader");
  for (unsigned number = 1;; number++) {
    std::string word = own + " " + std::to_string(number);
    writer->write(&word);
    std::string heard;
    SampleInfo info;
    while (reader->take_next_sample(&heard, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data && heard.compare(0, own.size(), own) != 0) say("got " + heard);
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
}
