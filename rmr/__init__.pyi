from rmr.base.errors import CompileError as CompileError
from rmr.base.errors import Error as Error
from rmr.base.errors import ProgramError as ProgramError
from rmr.base.errors import UsageError as UsageError
from rmr.eval.api import Compiled as Compiled
from rmr.eval.api import Evaluation as Evaluation
from rmr.eval.api import compile as compile  # noqa: A004 - as in `re`
from rmr.eval.api import evaluate as evaluate
from rmr.node.actions.dispatcher import ActionFailed as ActionFailed
from rmr.node.actions.dispatcher import RobotHandle as RobotHandle
from rmr.node.actions.dispatcher import action as action
from rmr_sim.event import EventError as EventError
from rmr_sim.simulation_api import Run as Run
from rmr_sim.simulation_api import simulate as simulate
from rmr_sim.sweep_api import Sweep as Sweep
from rmr_sim.sweep_api import sweep as sweep
from rmr_world.finding import LabError as LabError

__version__: str
