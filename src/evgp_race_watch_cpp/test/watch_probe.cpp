// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/// Runs a RaceStateWatch for test_race_state_watch.py, with commands on stdin, answers on stdout.
///
///     watch_probe <kind of node> <name> <lease, s>
///         <duration of a turn that keeps the executor busy, s; 0 if none does>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>

#include "evgp_race_watch_cpp/race_state_watch.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

using evgp_race_watch_cpp::Order;
using evgp_race_watch_cpp::RaceState;

struct Watch : evgp_race_watch_cpp::RaceStateWatch
{
  using RaceStateWatch::said;

  Watch(NodeInterfaces node, std::function<void(RaceState)> on_change, double lease)
  : RaceStateWatch(node, on_change, "kart_bridge/race_state", lease) {}
};

int number(RaceState state) {return static_cast<int>(state);}

template<typename NodeT>
void probe(const std::string & name, double lease, double busy)
{
  const auto node = std::make_shared<NodeT>(name);
  std::mutex writing, being_busy;
  const auto say = [&writing](const std::string & line) {
      const std::lock_guard<std::mutex> lock(writing);
      std::cout << line << std::endl;
    };
  std::condition_variable free;
  int busy_at = -1;
  Watch watch(*node, [&](RaceState state) {
      say("told " + std::to_string(number(state)));
      std::unique_lock<std::mutex> lock(being_busy);
      free.wait(lock, [&]() {return number(state) != busy_at;});
    }, lease);
  const std::chrono::duration<double> turn(busy);
  rclcpp::TimerBase::SharedPtr turns;
  if (turn.count() > 0) {
    turns = node->create_wall_timer(std::chrono::milliseconds(10), [&]() {
          say("turn 0");
          std::this_thread::sleep_for(turn);
        });
  }
  std::thread spinning([&node]() {rclcpp::spin(node->get_node_base_interface());});
  std::map<std::uint64_t, Order> orders;
  std::string word;
  while (std::cin >> word) {
    double value = 0.0;
    std::cin >> value;
    if (word == "look") {
      const auto order = watch.order();
      const auto said = watch.said();
      orders[order.serial] = order;
      std::ostringstream line;
      line << "look " << order.serial << ' ' << number(order.state) << ' ' << order.number << ' ' <<
        number(order.reached) << ' ' << (said ? number(said->state) : -1) << ' ' << watch.reason();
      say(line.str());
    } else if (word == "acknowledge") {
      watch.acknowledge(orders.at(static_cast<std::uint64_t>(value)));
    } else {
      const std::lock_guard<std::mutex> lock(being_busy);
      busy_at = static_cast<int>(value);
      free.notify_all();
    }
  }
  rclcpp::shutdown();
  spinning.join();
}

int main(int argc, char ** argv)
{
  const auto arguments = rclcpp::init_and_remove_ros_arguments(argc, argv);
  const bool plain = arguments.at(1) == "node";
  const auto run = plain ? probe<rclcpp::Node> : probe<rclcpp_lifecycle::LifecycleNode>;
  run(arguments.at(2), std::stod(arguments.at(3)), std::stod(arguments.at(4)));
}
