// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/// For test_orders.py, looks at orders in three threads while a fourth hears; prints what is wrong.

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <new>
#include <thread>
#include <vector>

#include "evgp_race_watch_cpp/orders.hpp"

using evgp_race_watch_cpp::Orders;
using evgp_race_watch_cpp::RaceState;
using evgp_race_watch_cpp::Said;

thread_local bool looking = false;
std::atomic<int> allocated{0};

void * operator new(std::size_t size)
{
  allocated += looking;
  if (void * memory = std::malloc(size)) {
    return memory;
  }
  throw std::bad_alloc();
}

void operator delete(void * memory) noexcept {std::free(memory);}
void operator delete(void * memory, std::size_t) noexcept {std::free(memory);}

int main()
{
  Orders orders(0.5);
  const std::uint64_t first = orders.glance(0.0).serial;
  std::atomic<bool> ended{false};
  std::atomic<int> torn{0}, over{0};
  std::vector<std::thread> threads;
  for (int each = 0; each < 3; ++each) {
    threads.emplace_back([&]() {
        looking = true;
        while (!ended) {
          const auto order = orders.glance(0.0);
          torn += order.number && order.serial != first + 6 * order.number - 1;
          over += order.state == RaceState::GREEN_GREEN;
        }
      });
  }
  for (std::uint64_t command = 1; command <= 100'000; ++command) {
    const auto say = [command](RaceState state) {return Said{1, state, state, command, false, ""};};
    const auto grid = say(RaceState::GRID_ACTIVE), green = say(RaceState::GREEN_GREEN);
    orders.hear({grid, green, say(RaceState::RED_RED)}, 0.0, 0.0);  // each is an order
  }
  ended = true;
  for (auto & each : threads) {
    each.join();
  }
  std::cout << torn << " torn, " << over << " over, " << allocated << " allocated" << std::endl;
}
