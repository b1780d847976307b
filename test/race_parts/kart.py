"""A kart with ROS: the real bridge in a process, and the team's side of its domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from evgp_node.states import state_of
from evgp_protocol.states import RaceState
from evgp_rcs_msgs import msg, srv
from race_parts.official import Answer, latched
from race_parts.process import Process
from race_parts.ros_side import RosSide
from std_msgs.msg import Bool
from std_srvs.srv import SetBool


class Bridge(Process):
    """
    A real ``kart_bridge_node`` on a domain.

    :param local_address: the kart's own address.
    :param parameters: more ROS parameters of the node.
    """

    def __init__(
        self,
        domain: int,
        port: int,
        local_address: str,
        parameters: Mapping[str, object] | None = None,
    ) -> None:
        """Start the bridge; it need not find race control."""
        self.domain = domain
        super().__init__(
            'evgp_kart_bridge',
            'kart_bridge_node',
            domain,
            {
                'host': '127.0.0.1',
                'port': port,
                'local_address': local_address,
                **(parameters or {}),
            },
        )


class ExampleStack(Process):
    """The example autonomy stack on the domain of its bridge."""

    def __init__(self, domain: int, parameters: Mapping[str, object] | None = None) -> None:
        """Start the stack; it need not find the bridge."""
        super().__init__('evgp_kart_bridge', 'example_stack', domain, parameters)


class Team(RosSide):
    """
    A team's node beside its bridge.

    ``state`` is the newest race state of the bridge and ``stop`` its lock; ``states`` are all
    race states heard, in order, without repetitions.
    """

    def __init__(self, domain: int, name: str = 'team') -> None:
        """Join the kart's domain."""
        super().__init__(name, domain)
        self.state: msg.KartRaceState | None = None
        self.states: list[RaceState | None] = []
        self.stop: bool | None = None
        self._acknowledge = self.node.create_client(srv.Acknowledge, '/kart_bridge/acknowledge')
        self._team_stop = self.node.create_client(SetBool, '/kart_bridge/team_stop')
        self.node.create_subscription(
            msg.KartRaceState, '/kart_bridge/race_state', self._hear_state, latched(1)
        )
        self.node.create_subscription(Bool, '/kart_bridge/stop', self._hear_stop, latched(1))
        self.spin()

    def acknowledge(self, state: RaceState) -> Answer:
        """
        Tell the bridge which state the kart has reached, and return its answer.

        :raises AssertionError: if the bridge does not answer in time.
        """
        reached = msg.RaceState(state=getattr(msg.RaceState, state.name))
        response: Any = self.request(self._acknowledge, srv.Acknowledge.Request(reached=reached))
        return Answer(response.success, response.message)

    def team_stop(self, engaged: bool) -> Answer:
        """
        Engage or release the team's own stop.

        :raises AssertionError: if the bridge does not answer in time.
        """
        response: Any = self.request(self._team_stop, SetBool.Request(data=engaged))
        return Answer(response.success, response.message)

    def wait_for(
        self, found: Callable[[msg.KartRaceState], object], what: str
    ) -> msg.KartRaceState:
        """
        Return the first race state for which `found` is true.

        :raises AssertionError: if none comes in time.
        """
        self.wait_until(
            lambda: self.state is not None and found(self.state),
            lambda: f'{what}; the bridge says: {self.state}',
        )
        assert self.state is not None
        return self.state

    def wait_for_state(self, state: RaceState) -> msg.KartRaceState:
        """
        Return once the state to obey is this one.

        :raises AssertionError: if it does not come in time.
        """
        return self.wait_for(lambda heard: state_of(heard.state) is state, f'obeys {state.value}')

    def wait_for_stop(self, stop: bool) -> None:
        """
        Return once the lock is this.

        :raises AssertionError: if it does not come in time.
        """
        self.wait_until(lambda: self.stop is stop, lambda: f'~/stop {stop}; it is {self.stop}')

    def _hear_state(self, state: msg.KartRaceState) -> None:
        with self.news:
            self.state = state
            heard = state_of(state.state)
            if not self.states or self.states[-1] is not heard:
                self.states.append(heard)
            self.news.notify_all()

    def _hear_stop(self, stop: Bool) -> None:
        with self.news:
            self.stop = stop.data
            self.news.notify_all()
