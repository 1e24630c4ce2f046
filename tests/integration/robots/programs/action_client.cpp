/* A client of ROS 2 actions on Debian's Fast DDS: `action_client DOMAIN`, led by lines on its standard input.

   goal N ACTION KIND VALUES...   send goal number N (its id is that octet sixteen times), then ask for its result;
                                  of a plan the values are INDEX NAME JSON, separated by tabs
   bare N ACTION KIND VALUES...   the same request without the header that rmw_cyclonedds puts before it
   cancel N ACTION KIND           cancel a goal; 0: all
   result N ACTION KIND           ask for the result of a goal
   octets TOPIC TYPE HEX          publish a message that is none
   It says what it sees: `writer TOPIC TYPE`, `reader TOPIC TYPE`, `goal N ACCEPTED`, `feedback N ...`, `state N STATUS`,
   `cancel N CODE GOALS...`, `result N STATUS ...`. Its profile comes from FASTRTPS_DEFAULT_PROFILES_FILE. */
#include <poll.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
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
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Octets = std::vector<char>;

static void say(const std::string& what) {
  static std::mutex one_at_a_time;
  std::lock_guard<std::mutex> hold(one_at_a_time);
  std::cout << what << std::endl;
}

static void stop_unless(bool well, const std::string& what) {
  if (well) return;
  std::cerr << what << " failed" << std::endl;
  std::exit(1);
}

/* Any type: its messages are octets with the header of CDR. */
class Any : public TopicDataType {
 public:
  explicit Any(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 65536;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const Octets& octets = *static_cast<Octets*>(data);
    if (octets.size() > payload->max_size) return false;
    std::memcpy(payload->data, octets.data(), octets.size());
    payload->encapsulation = CDR_LE;
    payload->length = static_cast<uint32_t>(octets.size());
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    auto* first = reinterpret_cast<char*>(payload->data);
    static_cast<Octets*>(data)->assign(first, first + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Octets*>(data)->size()); };
  }
  void* createData() override { return new Octets; }
  void deleteData(void* data) override { delete static_cast<Octets*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

struct Endpoints : DomainParticipantListener {
  void on_publisher_discovery(DomainParticipant* own, eprosima::fastrtps::rtps::WriterDiscoveryInfo&& seen) override {
    if (seen.info.guid().guidPrefix != own->guid().guidPrefix)
      say("writer " + seen.info.topicName().to_string() + " " + seen.info.typeName().to_string());
  }
  void on_subscriber_discovery(DomainParticipant* own, eprosima::fastrtps::rtps::ReaderDiscoveryInfo&& seen) override {
    if (seen.info.guid().guidPrefix != own->guid().guidPrefix)
      say("reader " + seen.info.topicName().to_string() + " " + seen.info.typeName().to_string());
  }
};

static Endpoints endpoints;
static DomainParticipant* participant;
static Publisher* publisher;
static Subscriber* subscriber;
static const uint64_t client = 0x1122334455667788u;
static int64_t requests = 0;

static Topic* topic(const std::string& name, const std::string& type_name) {
  TypeSupport type(new Any(type_name));
  type.register_type(participant);
  return participant->create_topic(name, type_name, TOPIC_QOS_DEFAULT);
}

static DataWriter* writer(const std::string& name, const std::string& type_name) {
  DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = VOLATILE_DURABILITY_QOS;
  qos.history().depth = 10;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  return publisher->create_datawriter(topic(name, type_name), qos);
}

static DataReader* reader(const std::string& name, const std::string& type_name, bool latched = false) {
  DataReaderQos qos = DATAREADER_QOS_DEFAULT;
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
  qos.history().depth = 10;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  return subscriber->create_datareader(topic(name, type_name), qos);
}

/* A message that is written, in CDR as ROS has it. */
struct Writing {
  FastBuffer buffer;
  Cdr cdr{buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR};
  Writing() { cdr.serialize_encapsulation(); }
  void header() { cdr << client << ++requests; }
  void goal_id(int number) {
    for (int i = 0; i < 16; i++) cdr << static_cast<uint8_t>(number);
  }
  Octets octets() { return {buffer.getBuffer(), buffer.getBuffer() + cdr.getSerializedDataLength()}; }
};

/* A message that is read. */
struct Reading {
  FastBuffer buffer;
  Cdr cdr;
  explicit Reading(Octets& octets) : buffer(octets.data(), octets.size()), cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR) {
    cdr.read_encapsulation();
  }
  template <typename Value>
  Value next() {
    Value value{};
    cdr >> value;
    return value;
  }
  int goal_id() {
    int number = next<uint8_t>();
    for (int i = 1; i < 16; i++) next<uint8_t>();
    return number;
  }
  double time() {
    auto seconds = next<int32_t>();
    return seconds + next<uint32_t>() / 1e9;
  }
  std::string step() {
    auto index = next<uint32_t>();
    auto name = next<std::string>();
    return std::to_string(index) + "=" + name + next<std::string>();
  }
  std::string steps() {
    std::string text;
    for (auto count = next<uint32_t>(); count > 0; count--) text += (text.empty() ? "" : ",") + step();
    return "[" + text + "]";
  }
};

struct Action {
  static constexpr int nobody = 255;
  bool is_plan, is_known = false;
  DataWriter *goal, *cancel, *result;
  DataReader *goal_reply, *cancel_reply, *result_reply, *feedback, *states;
  std::map<int64_t, int> goal_requests, cancel_requests, result_requests;
  std::map<int, int> last_state;

  Action(const std::string& name, const std::string& kind) : is_plan(kind == "ExecutePlan") {
    const std::string base = name + "/_action/", type = "c4i_asset_msgs::action::dds_::" + kind;
    goal = writer("rq" + base + "send_goalRequest", type + "_SendGoal_Request_");
    cancel = writer("rq" + base + "cancel_goalRequest", "action_msgs::srv::dds_::CancelGoal_Request_");
    result = writer("rq" + base + "get_resultRequest", type + "_GetResult_Request_");
    goal_reply = reader("rr" + base + "send_goalReply", type + "_SendGoal_Response_");
    cancel_reply = reader("rr" + base + "cancel_goalReply", "action_msgs::srv::dds_::CancelGoal_Response_");
    result_reply = reader("rr" + base + "get_resultReply", type + "_GetResult_Response_");
    feedback = reader("rt" + base + "feedback", type + "_FeedbackMessage_");
    states = reader("rt" + base + "status", "action_msgs::msg::dds_::GoalStatusArray_", true);
    stop_unless(goal && cancel && result && goal_reply && cancel_reply && result_reply && feedback && states, "endpoints");
    // What is written before the server knows the writer is lost. The last one is known when it is answered.
    for (int tries = 0; !is_known; tries++) {
      stop_unless(tries < 1500, "finding the server of " + name);
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      if (tries % 10 == 0 && matches()) ask_result(nobody);
      poll();
    }
  }
  bool matches() {
    PublicationMatchedStatus by;
    SubscriptionMatchedStatus to;
    for (auto* each : {goal, cancel, result})
      if (each->get_publication_matched_status(by) != ReturnCode_t::RETCODE_OK || by.current_count == 0) return false;
    for (auto* each : {goal_reply, cancel_reply, result_reply, feedback, states})
      if (each->get_subscription_matched_status(to) != ReturnCode_t::RETCODE_OK || to.current_count == 0) return false;
    return true;
  }
  void send(DataWriter* by, Writing& message) {
    Octets octets = message.octets();
    stop_unless(by->write(&octets), "writing");
  }
  void ask_result(int number) {
    Writing request;
    request.header();
    result_requests[requests] = number;
    request.goal_id(number);
    send(result, request);
  }
  void poll() {
    take(goal_reply, [this](Reading& reply) {
      int number = asked(reply, goal_requests);
      if (number < 0) return;
      bool accepted = reply.next<bool>();
      say("goal " + std::to_string(number) + (accepted ? " accepted" : " refused"));
      if (accepted) ask_result(number);
    });
    take(states, [this](Reading& message) {
      for (auto count = message.next<uint32_t>(); count > 0; count--) {
        int number = message.goal_id();
        message.time();
        int state = message.next<int8_t>();
        if (last_state[number] != state) say("state " + std::to_string(number) + " " + std::to_string(state));
        last_state[number] = state;
      }
    });
    take(feedback, [this](Reading& message) {
      std::string text = "feedback " + std::to_string(message.goal_id()) + " ";
      if (is_plan) {
        text += message.steps() + " ";
        text += message.steps() + " ";
        say(text + message.steps());
      } else {
        say(text + std::to_string(message.next<int32_t>()));
      }
    });
    take(cancel_reply, [this](Reading& reply) {
      int number = asked(reply, cancel_requests);
      if (number < 0) return;
      std::string text = "cancel " + std::to_string(number) + " " + std::to_string(reply.next<int8_t>());
      for (auto count = reply.next<uint32_t>(); count > 0; count--) {
        text += " " + std::to_string(reply.goal_id());
        reply.time();
      }
      say(text);
    });
    take(result_reply, [this](Reading& reply) {
      int number = asked(reply, result_requests);
      is_known = is_known || number == nobody;
      if (number < 0 || number == nobody) return;
      std::ostringstream text;
      text << "result " << number << " " << int(reply.next<int8_t>());
      if (is_plan) {
        for (auto count = reply.next<uint32_t>(); count > 0; count--) {
          std::string step = reply.step();
          double start = reply.time();
          text << " " << step << "@" << reply.time() - start;
        }
      } else {
        text << " " << reply.next<int32_t>();
      }
      say(text.str());
    });
  }
  /* Whose request it is; -1: another client's. */
  int asked(Reading& reply, std::map<int64_t, int>& of) {
    auto whose = reply.next<uint64_t>();
    auto number = reply.next<int64_t>();
    return whose == client && of.count(number) ? of[number] : -1;
  }
  template <typename What>
  void take(DataReader* from, What what) {
    Octets octets;
    SampleInfo info;
    while (from->take_next_sample(&octets, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      Reading message(octets);
      what(message);
    }
  }
};

static std::map<std::string, std::unique_ptr<Action>> actions;

static void put_goal(Writing& request, int number, const std::string& kind, std::istream& values) {
  request.goal_id(number);
  std::vector<double> numbers;
  if (kind == "ExecutePlan") {
    std::vector<std::string> words;
    for (std::string word; std::getline(values >> std::ws, word, '\t');) words.push_back(word);
    request.cdr << static_cast<uint32_t>(words.size() / 3);
    for (size_t i = 0; i + 2 < words.size(); i += 3)
      request.cdr << static_cast<uint32_t>(std::stoul(words[i])) << words[i + 1] << words[i + 2];
    return;
  }
  for (double value; values >> value;) numbers.push_back(value);
  if (kind == "CommandPath") request.cdr << static_cast<uint32_t>(numbers.size() / 3);
  if (kind == "CommandPlain") request.cdr << static_cast<uint8_t>(0);
  if (kind == "CommandBool") request.cdr << (numbers.at(0) != 0);
  if (kind == "CommandPath" || kind == "CommandWaypoint" || kind == "CommandNumeric")
    for (double value : numbers) request.cdr << value;
}

static void obey(const std::string& line) {
  std::istringstream words(line);
  std::string what, name, kind;
  int number = 0;
  words >> what;
  if (what == "octets") {
    std::string hex;
    words >> name >> kind >> hex;
    Octets octets;
    for (size_t i = 0; i + 1 < hex.size(); i += 2) octets.push_back(static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16)));
    auto* by = writer(name, kind);
    PublicationMatchedStatus match;
    do std::this_thread::sleep_for(std::chrono::milliseconds(10));
    while (by->get_publication_matched_status(match) == ReturnCode_t::RETCODE_OK && match.current_count == 0);
    stop_unless(by->write(&octets), "writing");
    return;
  }
  words >> number >> name >> kind;
  if (!actions.count(name)) actions[name] = std::make_unique<Action>(name, kind);
  Action& action = *actions[name];
  if (what == "goal" || what == "bare") {
    Writing request;
    if (what == "goal") {
      request.header();
      action.goal_requests[requests] = number;
    }
    put_goal(request, number, kind, words);
    action.send(action.goal, request);
  } else if (what == "result") {
    action.ask_result(number);
  } else {
    stop_unless(what == "cancel", "the line " + line);
    Writing request;
    request.header();
    action.cancel_requests[requests] = number;
    request.goal_id(number);
    request.cdr << int32_t(0) << uint32_t(0);
    action.send(action.cancel, request);
  }
}

int main(int argc, char** argv) {
  stop_unless(argc == 2, "reading the argument DOMAIN");
  auto* factory = DomainParticipantFactory::get_instance();
  stop_unless(factory->load_profiles() == ReturnCode_t::RETCODE_OK, "loading the profiles");
  participant = factory->create_participant(std::stoi(argv[1]), factory->get_default_participant_qos(), &endpoints,
                                            StatusMask::none());
  stop_unless(participant != nullptr, "making the participant");
  publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  std::string rest;
  for (;;) {
    pollfd input{STDIN_FILENO, POLLIN, 0};
    if (poll(&input, 1, 10) > 0) {
      char buffer[4096];
      ssize_t count = read(STDIN_FILENO, buffer, sizeof buffer);
      if (count <= 0) return 0;
      rest.append(buffer, static_cast<size_t>(count));
      for (size_t end; (end = rest.find('\n')) != std::string::npos; rest.erase(0, end + 1)) obey(rest.substr(0, end));
    }
    for (auto& each : actions) each.second->poll();
  }
}
