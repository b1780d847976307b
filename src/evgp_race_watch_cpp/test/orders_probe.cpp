// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/// Applies the rules in C++ for test_orders.py: reads one input a line, and prints one answer each.

#include <cstddef>
#include <cstdint>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "evgp_race_watch_cpp/orders.hpp"

using evgp_race_watch_cpp::Order;
using evgp_race_watch_cpp::Orders;
using evgp_race_watch_cpp::race_state;
using evgp_race_watch_cpp::Said;
using evgp_race_watch_cpp::valid_lease;

int main()
{
  std::unique_ptr<Orders> orders, others;  // of two watches, which hear the same
  std::vector<Order> seen;
  std::string word;
  double now = 0.0;
  while (std::cin >> word >> now) {
    bool asks = false;
    const auto glanced = orders ? orders->glance(now) : Order();
    if (word == "begin") {
      orders = std::make_unique<Orders>(0.5);
      others = std::make_unique<Orders>(0.5);
      seen.clear();
    } else if (word == "hear") {
      double since = 0.0;
      std::size_t count = 0;
      std::cin >> since >> count;
      std::vector<Said> heard(count);
      for (auto & said : heard) {
        int state = 0, reached = 0;
        std::cin >> said.bridge >> state >> reached >> said.order >> said.acknowledged;
        said.state = race_state(static_cast<std::uint8_t>(state));
        said.reached = race_state(static_cast<std::uint8_t>(reached));
        said.reason = "of bridge " + std::to_string(said.bridge);
      }
      orders->hear(heard, since, now);
      others->hear(heard, since, now);
    } else if (word == "bridges") {
      int alive = 0;
      std::cin >> alive;
      orders->count_bridges(alive);
      others->count_bridges(alive);
    } else if (word == "look") {
      orders->look(now);
      others->look(now);
    } else if (word == "lease") {
      try {
        valid_lease(now);
      } catch (const std::invalid_argument &) {
        asks = true;
      }
    } else if (word == "ask_with_anothers") {
      asks = orders->asks(others->order(now), now);
    } else {
      std::size_t index = 0;
      std::cin >> index;
      asks = orders->asks(seen[seen.size() - 1 - index % seen.size()], now);
    }
    const auto order = orders->order(now);
    bool wrong = orders->glance(now) != order || order == others->order(now);
    std::size_t index = 0;
    while (index < seen.size() && seen[index].serial != order.serial) {
      ++index;
    }
    for (const auto & each : seen) {
      wrong |= each.serial == glanced.serial && each != glanced;  // one serial, two orders
    }
    if (index == seen.size()) {
      seen.push_back(order);
    }
    std::cout << (wrong ? "wrong " : "") << name_of(glanced.state) << ' ' << index << ' ' << name_of(order.state) << ' ' << order.number << ' ' <<
      name_of(order.reached) << ' ' << asks << ' ' << orders->judge(now).second << std::endl;
  }
}
