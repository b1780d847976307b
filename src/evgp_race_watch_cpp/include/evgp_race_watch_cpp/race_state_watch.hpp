// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/// Tells a team's stack in C++ what to do now, and acknowledges what the kart has done.

#ifndef EVGP_RACE_WATCH_CPP__RACE_STATE_WATCH_HPP_
#define EVGP_RACE_WATCH_CPP__RACE_STATE_WATCH_HPP_

#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "evgp_race_watch_cpp/orders.hpp"
#include "evgp_rcs_msgs/msg/kart_race_state.hpp"
#include "evgp_rcs_msgs/srv/acknowledge.hpp"
#include "rclcpp/executors/executor_notify_waitable.hpp"
#include "rclcpp/node_interfaces/node_interfaces.hpp"
#include "rclcpp/rclcpp.hpp"

namespace evgp_race_watch_cpp
{

/// The bridge's default `liveliness_lease`, in seconds.
constexpr double LEASE = 0.5;

/// Decides what the kart must do now, like evgp_kart_bridge's RaceStateWatch, for a node in C++.
///
/// Use it in a wall timer (create_wall_timer), about 20 times a second:
///
///     const auto order = watch.order();
///     if (drive(order.state)) {watch.acknowledge(order);}  // true once that state is reached
///
/// It obeys GREEN_GREEN only after it has heard GRID_ACTIVE from the same bridge. Destroy it only
/// while nothing spins its node.
class RaceStateWatch
{
public:
  using Message = evgp_rcs_msgs::msg::KartRaceState;
  using Acknowledge = evgp_rcs_msgs::srv::Acknowledge;
  using NodeInterfaces = rclcpp::node_interfaces::NodeInterfaces<
    rclcpp::node_interfaces::NodeBaseInterface, rclcpp::node_interfaces::NodeGraphInterface,
    rclcpp::node_interfaces::NodeLoggingInterface, rclcpp::node_interfaces::NodeParametersInterface,
    rclcpp::node_interfaces::NodeServicesInterface, rclcpp::node_interfaces::NodeTopicsInterface,
    rclcpp::node_interfaces::NodeWaitablesInterface>;

  /// \param node an rclcpp::Node or LifecycleNode, active or not, or its interfaces.
  /// \param on_change called by the node's executor with each new state, first with RED_RED.
  /// \param topic the bridge's topic; the service `acknowledge` is in the same namespace.
  /// \param lease the bridge's `liveliness_lease`, or longer, but at most 2, in seconds.
  /// \throws std::invalid_argument if the lease is out of range.
  explicit RaceStateWatch(
    NodeInterfaces node, std::function<void(RaceState)> on_change = {},
    const std::string & topic = "kart_bridge/race_state", double lease = LEASE)
  : on_change_(std::move(on_change)), log_(node.get_node_logging_interface()->get_logger()),
    orders_(valid_lease(lease)),
    bell_(std::make_shared<rclcpp::GuardCondition>(node.get_node_base_interface()->get_context()))
  {
    const std::lock_guard<std::mutex> lock(ordering_);  // the node may spin already
    const auto base = node.get_node_base_interface();
    // One group, so that subscription and alarm never run at the same time.
    const auto group = base->create_callback_group(rclcpp::CallbackGroupType::MutuallyExclusive);
    bridge_ = rclcpp::create_client<Acknowledge>(
      base, node.get_node_graph_interface(), node.get_node_services_interface(),
      topic.substr(0, topic.rfind('/') + 1) + "acknowledge", rclcpp::ServicesQoS(), group);
    rclcpp::SubscriptionOptions options;
    options.callback_group = group;
    options.use_intra_process_comm = rclcpp::IntraProcessSetting::Disable;
    options.event_callbacks.liveliness_callback =
      [this](rclcpp::QOSLivelinessChangedInfo & info) {pass({}, info.alive_count);};
    auto qos = rclcpp::QoS(BACKLOG).reliable().durability_volatile();
    qos.liveliness(rclcpp::LivelinessPolicy::ManualByTopic);
    qos.liveliness_lease_duration(rclcpp::Duration::from_seconds(lease));
    subscription_ = rclcpp::create_subscription<Message>(
      node, topic, qos, [this](const Message & message) {pass({said_of(message)});}, options);
    // The middleware reports when the bridge is gone. In case it does not, the alarm lets the
    // watch check the clock. A timer would not work, because some middlewares wait for timers by
    // the wall clock, which may be set back. The node's own guard condition would make the executor
    // collect its nodes again.
    alarm_ = std::make_shared<rclcpp::executors::ExecutorNotifyWaitable>([this]() {pass({});});
    alarm_->add_guard_condition(bell_);
    node.get_node_waitables_interface()->add_waitable(alarm_, group);
    const std::chrono::duration<double> interval(std::min(lease / 5, 0.1));
    ringing_ = std::thread([this, interval]() {
          while (!ended_) {
            std::this_thread::sleep_for(interval);
            bell_->trigger();
          }
        });
  }

  RaceStateWatch(const RaceStateWatch &) = delete;
  RaceStateWatch & operator=(const RaceStateWatch &) = delete;

  ~RaceStateWatch()
  {
    ended_ = true;
    ringing_.join();
  }

  /// The current order. Obey its `state`; once the kart has reached that, acknowledge the order.
  ///
  /// It stays the same until the kart has to do something else. The state is RED_RED if the bridge
  /// publishes RED_RED, has not been heard yet, has been silent for the lease, is gone, or
  /// publishes an unknown state. It is also RED_RED if two bridges run, or if the watch has not
  /// heard GRID_ACTIVE before GREEN_GREEN. You can call this in any thread, even while the executor
  /// is busy, and in a loop of 1 kHz: it takes no lock and allocates nothing, unlike acknowledge().
  Order order() const {return orders_.glance(now());}

  /// Why the state is not what race control commands, for people; empty if it is.
  std::string reason() const
  {
    const std::lock_guard<std::mutex> lock(ordering_);
    return orders_.judge(now()).second;
  }

  /// Report to race control that the kart has reached the state of this order.
  ///
  /// Call this in every step in which that is true. If the answer is lost, or the bridge refuses,
  /// the watch tries again after 0.2 s; after a refusal, the node logs why. This function never
  /// waits. It does nothing if the order is over, is already acknowledged, has no number or is from
  /// another watch.
  ///
  /// \param order the order() that the kart acted on.
  void acknowledge(const Order & order)
  {
    {
      const std::lock_guard<std::mutex> lock(ordering_);
      if (!orders_.asks(order, now())) {
        return;
      }
    }
    bridge_->prune_pending_requests();  // the bridge may have died before it answered
    auto request = std::make_shared<Acknowledge::Request>();
    request->order = order.number;
    request->reached.state = static_cast<std::uint8_t>(order.reached);
    bridge_->async_send_request(
      request, [this, order](rclcpp::Client<Acknowledge>::SharedFuture answered) {
        const auto answer = answered.get();
        if (!answer->success && order == this->order()) {
          RCLCPP_WARN_THROTTLE(
            log_, steady_, 1000, "%s cannot be acknowledged: %s", name_of(order.reached),
            answer->message.c_str());
        }
      });
  }

protected:
  /// For tests: the bridge's last message, if there was one.
  std::optional<Said> said() const
  {
    const std::lock_guard<std::mutex> lock(ordering_);
    return orders_.said();
  }

private:
  // The bridge publishes fewer messages than this in the longest doubt that the rules tolerate.
  static constexpr std::size_t BACKLOG = 100;

  /// The time since boot, including suspend, in seconds.
  static double now()
  {
    timespec time{};
    clock_gettime(CLOCK_BOOTTIME, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  }

  static Said said_of(const Message & message)
  {
    return {message.bridge, race_state(message.state.state), race_state(message.reached.state),
      message.order, message.acknowledged, message.reason};
  }

  /// Process these messages and all waiting ones: a stop must not wait behind earlier messages.
  /// All of them are newer than the last pass, which would otherwise have taken them. (The stamp
  /// would show their time only if the clocks of bridge and stack agreed.)
  void pass(std::vector<Said> heard, std::optional<int> bridges_alive = {})
  {
    std::unique_lock<std::mutex> lock(ordering_);
    if (bridges_alive) {
      orders_.count_bridges(*bridges_alive);
    }
    const double began = now();
    Message message;
    rclcpp::MessageInfo information;
    while (heard.size() <= BACKLOG && subscription_->take(message, information)) {
      heard.push_back(said_of(message));
    }
    if (!heard.empty()) {
      orders_.hear(heard, passed_, now());
    }
    passed_ = began;
    orders_.look(now());
    const auto state = orders_.order(now()).state;
    const auto reason = orders_.judge(now()).second;
    const bool unheard = !orders_.said();
    lock.unlock();  // neither the log nor on_change_ must delay readers of the order
    if (state != reported_) {
      reported_ = state;
      if (on_change_) {
        on_change_(state);
      }
    }
    if (!unheard) {
      log_reason(state, reason);
    } else if (began > began_ + 2.0) {
      log_reason(
        state, std::string("no bridge is heard on ") + subscription_->get_topic_name() +
        ": is it running, with the same ROS_DOMAIN_ID?");
    }
  }

  /// Log each new reason: the same one at most once in 10 s, and at most 20 in that time.
  void log_reason(RaceState state, const std::string & reason)
  {
    if (reason != logged_last_ && !reason.empty()) {
      for (auto each = logged_.begin(); each != logged_.end(); ) {
        each = now() - each->second < 10.0 ? std::next(each) : logged_.erase(each);
      }
      if (logged_.size() >= 20 || !logged_.emplace(reason, now()).second) {
        return;
      }
      RCLCPP_WARN(log_, "The kart obeys %s: %s", name_of(state), reason.c_str());
    }
    logged_last_ = reason;
  }

  mutable std::mutex ordering_;  // guards orders_, except glance()
  const std::function<void(RaceState)> on_change_;
  const rclcpp::Logger log_;
  Orders orders_;
  double began_ = now();
  double passed_ = began_;  // all messages from before this time were taken
  RaceState reported_ = RaceState::UNKNOWN;  // to on_change_
  std::map<std::string, double> logged_;  // reasons, and when each was logged
  std::string logged_last_;
  rclcpp::Clock steady_{RCL_STEADY_TIME};
  std::atomic<bool> ended_{false};
  const rclcpp::GuardCondition::SharedPtr bell_;
  std::thread ringing_;
  rclcpp::Client<Acknowledge>::SharedPtr bridge_;
  rclcpp::Subscription<Message>::SharedPtr subscription_;
  std::shared_ptr<rclcpp::executors::ExecutorNotifyWaitable> alarm_;
};

}  // namespace evgp_race_watch_cpp

#endif  // EVGP_RACE_WATCH_CPP__RACE_STATE_WATCH_HPP_
