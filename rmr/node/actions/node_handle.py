"""What rmr's own actions are made of: their handle of the robot, and the object that the dispatcher resumes.

Like `rmr.node.actions.handle` this module is never compiled.
"""

from typing import Any, NoReturn

from rmr.base.time import Instant
from rmr.node.actions.dispatcher import Permit, RunningAction
from rmr.node.actions.handle import ActionFailed, Pause, RobotHandle
from rmr.node.config import STUCK
from rmr.node.parts import ActionHost


class NodeTime:
    """Returns the instant of a robot's present call."""

    __slots__ = ("_node",)

    def __init__(self, node: ActionHost) -> None:
        self._node = node

    def __call__(self) -> Instant:
        """Return it."""
        return self._node.now


class NodeHandle(RobotHandle):
    """What rmr's own actions may do beyond a user's."""

    __slots__ = ("_action",)

    def __init__(self, node: ActionHost, action: RunningAction) -> None:
        super().__init__(NodeTime(node), node, action)
        self._action = action

    @property
    def node(self) -> ActionHost:
        """The robot."""
        node: ActionHost = self._node
        return node

    def needs_no_queue(self) -> bool:
        """Return whether the robot need not line up: it has entered since, wasted a slot, or is beyond."""
        return self.node.needs_no_queue(self._action.derived)

    @property
    def permit(self) -> Permit | None:
        """The crossing by which the action goes."""
        return self._action.permit

    @property
    def waits_for_turn(self) -> bool:
        """Whether it is not yet the action's turn, at its goal or at a passage on its way."""
        return any(each is not None and each.waits for each in (self._action.permit, self._action.gate))

    @property
    def missed(self) -> int | None:
        """The assertion whose missed deadline derived the action."""
        return self._action.missed


class ActionSteps:
    """A provided action under way: what the dispatcher resumes, and a handler may await.

    It does what a coroutine does. Its state stands in attributes, from which it can be saved and made again; that of a
    coroutine cannot.
    """

    __slots__ = ("_drives", "_robot")

    def __init__(self, robot: NodeHandle) -> None:
        self._robot = robot
        self._drives = False
        """Whether the wheels are to be stopped at the end."""

    def __await__(self) -> Any:
        return self

    def __iter__(self) -> "ActionSteps":
        return self

    def __next__(self) -> Pause:
        try:
            pause = self.resume()
        except BaseException:
            self.close()
            raise
        if pause is None:
            self.close()
            raise StopIteration
        return pause

    def resume(self) -> Pause | None:
        """Go on; return what is awaited then, None at the end. Raises ActionFailed."""
        raise NotImplementedError

    def throw(self, *error: Any) -> NoReturn:
        """Break the action off, and raise."""
        self.close()
        raise error[0]

    def close(self) -> None:
        """Break the action off: a handler of which it is one step may go on."""
        if self._drives:
            self._drives = False
            self._robot.node.halt()


class LocatedSteps(ActionSteps):
    """An action that needs the robot's pose: it begins, and goes on, when there is one.

    It fails if the robot does not find out where it is.
    """

    __slots__ = ("_begun", "_lost", "_prepared")

    def __init__(self, robot: NodeHandle) -> None:
        super().__init__(robot)
        self._prepared = False
        self._begun = False
        self._lost = False
        """Whether it waits for another pose: the estimate has been dropped."""

    def resume(self) -> Pause | None:
        """Prepare, wait for a pose, begin, go on."""
        node = self._robot.node
        if not self._prepared:
            self._prepared = True
            if not self.prepare():
                return None
            if node.pose is None:
                return Pause(node.now + STUCK, self._is_located)
        if not self._begun:
            if node.pose is None:
                raise ActionFailed("the robot does not know where it is")
            self._begun = True
            return self.begin()
        if node.pose is None:
            if self._lost:
                raise ActionFailed("the robot does not know any more where it is")
            self._lost = True
            return Pause(node.now + STUCK, self._is_located)
        self._lost = False
        return self.go_on()

    def _is_located(self) -> bool:
        return self._robot.node.pose is not None

    def prepare(self) -> bool:
        """Look at the arguments; return False if there is nothing to do. Raises ActionFailed."""
        return True

    def begin(self) -> Pause | None:
        """Begin; return what is awaited. Raises ActionFailed."""
        raise NotImplementedError

    def go_on(self) -> Pause | None:
        """Go on after what was awaited. Raises ActionFailed."""
        raise NotImplementedError
