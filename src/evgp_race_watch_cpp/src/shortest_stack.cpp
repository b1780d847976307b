// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/// The shortest stack in C++ that obeys race control: evgp_kart_bridge's shortest_stack.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>

#include "evgp_race_watch_cpp/race_state_watch.hpp"
#include "geometry_msgs/msg/twist.hpp"
#include "nav_msgs/msg/odometry.hpp"
#include "rclcpp/rclcpp.hpp"

using evgp_race_watch_cpp::RaceState;
using evgp_race_watch_cpp::RaceStateWatch;
using geometry_msgs::msg::Twist;
using nav_msgs::msg::Odometry;

constexpr double STANDSTILL_TIME = 0.5;  // s; longer than your kart's dead time plus 0.1 s
constexpr double ODOMETRY_GAP = 0.2;  // s; older odometry does not count
constexpr double INFINITE = std::numeric_limits<double>::infinity();

/// Drives straight ahead when the race state allows it.
class Stack : public rclcpp::Node
{
public:
  Stack()
  : Node("stack"), watch_(*this)
  {
    motors_ = create_publisher<Twist>("cmd_vel", rclcpp::QoS(1));
    odometry_ = create_subscription<Odometry>(
      "odom", rclcpp::QoS(10), [this](const Odometry & odometry) {hear_odometry(odometry);});
    timer_ = create_wall_timer(  // ROS time may stop
      std::chrono::milliseconds(50), [this]() {
        const auto order = watch_.order();  // RED_RED also when the bridge dies
        if (drive(order.state)) {
          watch_.acknowledge(order);
        }
      });
  }

private:
  /// Drive or brake; return whether the kart has reached the state. Put your code here.
  bool drive(RaceState state)
  {
    const bool fresh = now_s() - heard_at_ < ODOMETRY_GAP;
    driving_ = fresh && state == RaceState::GREEN_GREEN;  // not without odometry
    if (driving_) {
      wanted_ = 6.0;
    } else if (fresh && state == RaceState::RED_FLAG) {  // gently: 10 s from 6 m/s
      wanted_ = std::max(0.0, std::min(speed_, wanted_) - 0.03);
    } else {
      wanted_ = 0.0;
    }
    Twist command;
    command.linear.x = wanted_;
    motors_->publish(command);
    if (driving_) {
      still_since_ = INFINITE;  // a standstill counts from the first command to stop
      return speed_ > 0.1;
    }
    const bool still = fresh && heard_at_ - still_since_ >= STANDSTILL_TIME;
    return still && state != RaceState::GREEN_GREEN;
  }

  /// Update the speed, and the time since which the kart certainly stands still.
  void hear_odometry(const Odometry & odometry)
  {
    const double now = now_s();
    speed_ = std::abs(odometry.twist.twist.linear.x);
    if (driving_ || !(speed_ < 0.05)) {  // also NaN
      still_since_ = INFINITE;
    } else if (now - heard_at_ > ODOMETRY_GAP) {
      still_since_ = now;
    } else {
      still_since_ = std::min(still_since_, now);
    }
    heard_at_ = now;
  }

  static double now_s()
  {
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    return std::chrono::duration<double>(now).count();
  }

  RaceStateWatch watch_;
  double speed_ = std::nan("");  // m/s
  double wanted_ = 0.0;  // m/s
  bool driving_ = false;
  double heard_at_ = -INFINITE;  // s, the last odometry
  double still_since_ = INFINITE;  // s; infinite: the kart moves
  rclcpp::Publisher<Twist>::SharedPtr motors_;
  rclcpp::Subscription<Odometry>::SharedPtr odometry_;
  rclcpp::TimerBase::SharedPtr timer_;
};

/// Run the stack. The base must brake when commands stop coming.
int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<Stack>());
  rclcpp::shutdown();
}
