// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/// The rules by which RaceStateWatch decides what a stack must do.
///
/// They use no ROS, clock or thread. `orders.py` of evgp_kart_bridge contains the same rules in
/// Python, and explains them; `test_orders.py` compares the two.

#ifndef EVGP_RACE_WATCH_CPP__ORDERS_HPP_
#define EVGP_RACE_WATCH_CPP__ORDERS_HPP_

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace evgp_race_watch_cpp
{

/// A race state of the proposal (§3.A), with the same number as in evgp_rcs_msgs/RaceState.
enum class RaceState : std::uint8_t
{
  UNKNOWN, IN_GARAGE, GRID_ACTIVE, GREEN_GREEN, RED_FLAG, RED_RED
};

/// The race state with this number in messages; UNKNOWN if there is none.
inline RaceState race_state(std::uint8_t number)
{
  const bool known = number <= static_cast<std::uint8_t>(RaceState::RED_RED);
  return known ? static_cast<RaceState>(number) : RaceState::UNKNOWN;
}

/// The name of a race state on the wire.
inline const char * name_of(RaceState state)
{
  static const char * const names[] = {
    "UNKNOWN", "IN_GARAGE", "GRID_ACTIVE", "GREEN_GREEN", "RED_FLAG", "RED_RED"};
  return names[static_cast<std::uint8_t>(state)];
}

/// The parts of a bridge's message that the rules use.
struct Said
{
  std::uint64_t bridge = 0;
  RaceState state = RaceState::UNKNOWN;
  RaceState reached = RaceState::UNKNOWN;
  std::uint64_t order = 0;
  bool acknowledged = false;
  std::string reason;
};

/// What the kart must do from a certain moment on; by default RED_RED, without acknowledgement.
struct Order
{
  std::uint64_t serial = 0;  ///< Unique in this process; 0 if the order is from no watch.
  RaceState state = RaceState::RED_RED;  ///< The state to obey; never UNKNOWN.
  std::uint64_t number = 0;  ///< Of race control's command; 0 if it cannot be acknowledged.
  RaceState reached = RaceState::UNKNOWN;  ///< The state to acknowledge; UNKNOWN if none.

  friend bool operator==(const Order & one, const Order & other)
  {
    return one.serial == other.serial && one.state == other.state &&
           one.number == other.number && one.reached == other.reached;
  }

  friend bool operator!=(const Order & one, const Order & other) {return !(one == other);}
};

/// Maximum duration of a doubt after which a stack still obeys GREEN_GREEN without a new
/// GRID_ACTIVE, in seconds.
constexpr double FORGIVEN = 1.0;

/// Return the lease of a watch, in seconds.
///
/// \throws std::invalid_argument if a kart would drive on for too long after its bridge has died.
inline double valid_lease(double lease)
{
  if (!(lease > 0.0 && lease <= 2.0)) {
    throw std::invalid_argument("lease must be above 0 s and at most 2 s");
  }
  return lease;
}

/// The orders of one stack. All times are in seconds, from one clock that never goes back.
class Orders
{
public:
  /// \param lease silence of the bridge after which the kart must obey RED_RED, in seconds.
  explicit Orders(double lease)
  : lease_(lease) {order(never);}

  /// The bridge's last message, if there was one.
  const std::optional<Said> & said() const {return said_;}

  /// The current order; its serial stays the same until the kart has to do something else.
  Order order(double now)
  {
    settle(now);
    Slot & slot = slots_[(turn_ + 1) % slots_.size()];  // glance() may read the one before
    slot.serial = order_.serial;
    slot.state = order_.state;
    slot.number = order_.number;
    slot.reached = order_.reached;
    slot.ends_at = ends_at();
    ++turn_;
    return order_;
  }

  /// The last result of order(), but RED_RED once that result has expired without a new message.
  ///
  /// Call it in any thread, even while another one calls a non-const function: it takes no lock
  /// and allocates nothing.
  Order glance(double now) const
  {
    while (true) {
      const std::size_t turn = turn_;
      const Slot & slot = slots_[turn % slots_.size()];
      const Order order{slot.serial, slot.state, slot.number, slot.reached};
      const bool is_over = now > slot.ends_at;
      if (turn_ - turn < slots_.size() - 1) {  // otherwise order() may have changed the slot
        return is_over ? Order{order.serial | 1} : order;
      }
    }
  }

  /// The state to obey, and why it differs from the command; empty if it does not.
  std::pair<RaceState, std::string> judge(double now) const
  {
    const auto why = doubt(now);
    if (!why.empty()) {
      return {RaceState::RED_RED, why};
    }
    if (said_->state == RaceState::UNKNOWN) {
      return {RaceState::RED_RED, "the bridge publishes an unknown race state"};
    }
    if (said_->state == RaceState::GREEN_GREEN && !is_armed(now)) {
      return {RaceState::RED_RED, grid_by_ == said_->bridge ?
        "this node was too busy, or the bridge silent, for more than 1 s since GRID_ACTIVE; the "
        "kart waits for the next one" : "no GRID_ACTIVE was heard before GREEN_GREEN"};
    }
    return {said_->state, said_->reason};
  }

  /// Why the last message may no longer be true; empty if there is no doubt.
  std::string doubt(double now) const
  {
    if (!said_) {
      return "the bridge has not been heard yet";
    }
    if (now - heard_at_ > lease_) {
      return "the bridge is silent, or this node was too busy to hear it";
    }
    if (!is_alone()) {
      return std::to_string(*bridges_alive_) + " bridges are running; there must be one";
    }
    return "";
  }

  /// Process the bridge's messages, oldest first; none of them was sent before `since`.
  void hear(const std::vector<Said> & heard, double since, double now)
  {
    settle(now);  // a doubt or another state in between ends the previous order
    heard_at_ = since;
    for (const auto & said : heard) {
      said_ = said;
      follow(now);
      settle(now);
    }
    order(now);  // only now: glance() must not return a GREEN_GREEN that is already over
  }

  /// Process the number of bridges that the middleware reports as alive.
  void count_bridges(int alive)
  {
    bridges_alive_ = alive;
    if (alive > 1) {
      armed_by_.reset();
      grid_by_.reset();
    }
  }

  /// Let time pass; call it about five times in each lease.
  void look(double now)
  {
    if (doubt(now).empty()) {
      if (!is_armed(now)) {
        armed_by_.reset();
      }
      sure_at_ = now;
    }
  }

  /// Whether to send the bridge the acknowledgement of this order now.
  bool asks(const Order & done, double now)
  {
    const Order present = order(now);
    if (done != present || present.number == 0 || said_->acknowledged) {
      return false;
    }
    if (done.serial == asked_ && now < ask_again_at_) {
      return false;
    }
    asked_ = done.serial;
    ask_again_at_ = now + 0.2;
    return true;
  }

private:
  static constexpr double endless = std::numeric_limits<double>::infinity();
  static constexpr double never = -endless;

  struct Slot
  {
    std::atomic<std::uint64_t> serial{0}, number{0};
    std::atomic<RaceState> state{RaceState::RED_RED}, reached{RaceState::UNKNOWN};
    std::atomic<double> ends_at{0.0};
    static_assert(decltype(serial)::is_always_lock_free && decltype(ends_at)::is_always_lock_free);
  };

  /// Begin a new order if the kart has to do something else.
  void settle(double now)
  {
    Order order{order_.serial, judge(now).first};
    if (said_ && doubt(now).empty() && said_->order && includes(order.state, said_->reached)) {
      order.number = said_->order;
      order.reached = said_->reached;
    }
    if (order != order_) {
      // Odd if and only if the rest equals Order{}, so that glance() can predict the next serial.
      const bool is_doubt = order == Order{order.serial};
      order.serial = (order.serial | 1) + (is_doubt ? 0 : 1);
      order_ = order;
    }
  }

  /// The time at which the current order expires without a new message.
  double ends_at() const
  {
    const bool starts = order_.state == RaceState::GREEN_GREEN;
    const double unarmed_at = starts ? sure_at_ + FORGIVEN : endless;
    return order_ == Order{order_.serial} ? endless : std::min(heard_at_ + lease_, unarmed_at);
  }

  bool is_alone() const {return !bridges_alive_ || *bridges_alive_ == 1;}

  bool is_armed(double now) const
  {
    return said_ && armed_by_ == said_->bridge && now - sure_at_ <= FORGIVEN;
  }

  /// Arm or disarm by the newest message.
  void follow(double now)
  {
    if (said_->state == RaceState::GRID_ACTIVE) {
      grid_by_ = said_->bridge;
    } else if (said_->state != RaceState::GREEN_GREEN) {
      grid_by_.reset();
    }
    const bool sure = doubt(now).empty();
    if (said_->state == RaceState::GRID_ACTIVE) {
      const bool forgives = now - sure_at_ <= FORGIVEN && is_alone();
      armed_by_ = sure || forgives ? std::optional(said_->bridge) : std::nullopt;
    } else if (said_->state != RaceState::GREEN_GREEN || !is_armed(now)) {
      armed_by_.reset();
    }
    if (sure) {
      sure_at_ = now;
    }
  }

  /// Whether a kart that has reached `state` may acknowledge `reached`.
  static bool includes(RaceState state, RaceState reached)
  {
    return state == reached ||
           (state == RaceState::RED_RED && reached == RaceState::RED_FLAG);
  }

  const double lease_;
  std::optional<Said> said_;
  double heard_at_ = never;
  std::optional<int> bridges_alive_;  // none until the middleware reports it
  std::optional<std::uint64_t> armed_by_;  // the bridge whose GRID_ACTIVE was heard
  std::optional<std::uint64_t> grid_by_;  // the same, even if it no longer arms
  double sure_at_ = never;  // the last time without a doubt
  static inline std::atomic<std::uint64_t> watches_{0};  // each has its own serials
  Order order_{++watches_ << 40 | 1};
  std::array<Slot, 4> slots_;  // the last values of order_, and when each expires
  std::atomic<std::size_t> turn_{0};
  std::uint64_t asked_ = 0;
  double ask_again_at_ = never;
};

}  // namespace evgp_race_watch_cpp

#endif  // EVGP_RACE_WATCH_CPP__ORDERS_HPP_
