"""The shortest stack that obeys race control. README shows this file as it stands."""

from evgp_kart_bridge.watch import RaceStateWatch
from evgp_protocol.states import RaceState
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


class Stack(Node):
    """Drives straight ahead where the race state lets it."""

    def __init__(self) -> None:
        """Watch the race state and odometry, and begin to drive."""
        super().__init__('stack')
        self.watch = RaceStateWatch(self)
        self.speed = 0.0  # m/s
        self.still = 0  # how many odometry messages in a row have shown a standstill
        self.motors = self.create_publisher(Twist, 'cmd_vel', 1)
        self.create_subscription(Odometry, 'odom', self.hear_odometry, 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a timer on ROS time may stop
        self.create_timer(0.05, self.step, clock=steady)

    def step(self) -> None:
        """Do what race control orders; acknowledge that same order once it is done."""
        order = self.watch.order  # RED_RED also when the bridge dies
        if self.drive(order.state):
            self.watch.acknowledge(order)

    def drive(self, state: RaceState) -> bool:
        """Drive or brake; return whether the kart has reached the state. Yours goes here."""
        command = Twist()
        if state is RaceState.GREEN_GREEN:
            command.linear.x = 6.0
            self.still = 0  # what odometry has shown until now says nothing about a later stop
        self.motors.publish(command)
        if state is RaceState.GREEN_GREEN:
            return self.speed > 0.1
        return self.still >= 10  # 0.2 s of odometry at 50 Hz

    def hear_odometry(self, odometry: Odometry) -> None:
        """Take the speed; count how long the kart has been standing."""
        self.speed = abs(odometry.twist.twist.linear.x)
        self.still = self.still + 1 if self.speed < 0.05 else 0


def main() -> None:
    """Run the stack. The base must brake when commands stop coming."""
    rclpy.init()
    try:
        rclpy.spin(Stack())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
