/* Topics at steady rates on Fast DDS: `steady_fast write|read DOMAIN:BYTES:HZ:reliable|best-effort ...`.
   As steady_python.py. Its profile comes from FASTRTPS_DEFAULT_PROFILES_FILE, as it does in a ROS node. */
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Clock = std::chrono::steady_clock;

static void say(const std::string& what) {
  double now = std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
  std::cout << std::fixed << now << " " << what << std::endl;
}

static const auto stop_unless = [](bool well, const char* what) {
  if (!well) {
    std::cerr << what << " failed" << std::endl;
    std::exit(1);
  }
};

/* std_msgs/msg/String: a CDR header, the length with the closing zero, the characters. */
class Word : public TopicDataType {
 public:
  Word() {
    setName("std_msgs::msg::dds_::String_");
    m_typeSize = 16384;
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

struct Steady {
  std::string domain;
  size_t size;
  std::chrono::duration<double> every;
  DataWriter* writer = nullptr;
  DataReader* reader = nullptr;
  bool matched = false;
  Clock::time_point due;
  unsigned number = 0;

  Steady(bool writes, const std::string& text) {
    std::vector<std::string> part(1);
    for (char letter : text)
      if (letter == ':') part.emplace_back();
      else part.back() += letter;
    stop_unless(part.size() == 4, "reading DOMAIN:BYTES:HZ:RELIABILITY");
    domain = part[0];
    size = std::stoul(part[1]);
    every = std::chrono::duration<double>(1 / std::stod(part[2]));
    auto kind = part[3] == "reliable" ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    auto* factory = DomainParticipantFactory::get_instance();
    auto* participant = factory->create_participant(std::stoi(domain), factory->get_default_participant_qos());
    stop_unless(participant != nullptr, "making the participant");
    TypeSupport type(new Word);
    type.register_type(participant);
    auto* topic = participant->create_topic("rt/steady", type.get_type_name(), TOPIC_QOS_DEFAULT);
    if (writes) {
      DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
      qos.reliability().kind = kind;
      qos.durability().kind = VOLATILE_DURABILITY_QOS;
      qos.history().depth = 10;
      qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;  // for messages that do not fit into a datagram
      writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, qos);
    } else {
      DataReaderQos qos = DATAREADER_QOS_DEFAULT;
      qos.reliability().kind = kind;
      qos.history().depth = 10;
      reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, qos);
    }
    stop_unless(writer != nullptr || reader != nullptr, "making writer or reader");
  }

  void act() {
    if (reader != nullptr) {
      std::string heard;
      SampleInfo info;
      while (reader->take_next_sample(&heard, &info) == ReturnCode_t::RETCODE_OK)
        if (info.valid_data) say("got " + domain + " " + heard.substr(0, heard.find(' ')));
      return;
    }
    PublicationMatchedStatus status;
    writer->get_publication_matched_status(status);
    if (!matched && status.current_count > 0) {
      matched = true;
      say("matched " + domain);
      due = Clock::now();
    }
    if (matched && Clock::now() >= due) {
      due += std::chrono::duration_cast<Clock::duration>(every);
      std::string word = std::to_string(++number) + " ";
      word.resize(size - 9, 'x');
      writer->write(&word);
    }
  }
};

int main(int argc, char** argv) {
  stop_unless(argc >= 3, "reading the arguments");
  stop_unless(DomainParticipantFactory::get_instance()->load_profiles() == ReturnCode_t::RETCODE_OK,
              "loading the profiles");
  std::vector<std::unique_ptr<Steady>> topics;
  for (int number = 2; number < argc; number++)
    topics.emplace_back(new Steady(std::string(argv[1]) == "write", argv[number]));
  for (;;) {
    for (auto& topic : topics) topic->act();
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}
