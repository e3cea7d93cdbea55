"""Runs a conformance case: octets and a script of what happens from outside in, a trace out (see README.md)."""

import json
from typing import Any

from rmr.base.streams import Choices
from rmr.base.values import Robot, Value, format_fact, format_value
from rmr.bytecode.program import ANY, Anything, Kind, Pattern, Program
from rmr.lang.analyse.folding import Folder
from rmr.lang.fact_text import read_fact
from rmr.lang.read.syntax import Literal, Variable
from rmr.vm.engines import Engine, new_machine
from rmr.vm.job import TimedJob
from rmr.vm.machine import FIRING_BUDGET
from rmr.vm.machine_events import (
    ActionCancelled,
    ActionDerived,
    BoundReached,
    ExpressionFailed,
    FactInserted,
    FactRemoved,
    FactSent,
    FinishAwaited,
    FinishSeen,
    GoalAchieved,
    GoalSent,
    GoalWithdrawn,
    JobFinished,
    JobMissed,
    JobStarted,
    RuleFired,
    RuleRepeats,
    VmEvent,
)

Line = dict[str, Any]
"""A line of a script or a trace: JSON."""

HEX_OCTETS = 32
"""Octets on a line of a file of hex."""


def as_hex(octets: bytes) -> str:
    """Return octets as lines of hex."""
    return "".join(octets[at : at + HEX_OCTETS].hex() + "\n" for at in range(0, len(octets), HEX_OCTETS))


def as_lines(trace: list[Line]) -> str:
    """Return a trace as JSON lines."""
    return "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in trace)


class Case:
    """One robot that runs a program."""

    def __init__(self, program: Program, script: dict[str, Any], engine: Engine) -> None:
        self.program = program
        self.script = script
        self.robot: int = script.get("robot", 1)
        budget = script.get("budget", FIRING_BUDGET)
        choices = Choices(str(script.get("seed", 0)))
        self.machine = new_machine(program, self.robot, choices, engine=engine, firing_budget=budget, trace=True)

    def run(self) -> list[Line]:
        """Return what happens."""
        trace: list[Line] = []
        self.machine.start(0)
        for event in [{"at": 0}, *self.script["events"]]:
            now = event["at"]
            self.hand_in(now, event)
            self.machine.run(now)
            trace += [{"at": now, **self.line(each)} for each in self.machine.drain()]
        return [*trace, self.state()]

    def state(self) -> Line:
        """What is left at the end."""
        held = self.machine.held
        facts = [
            self.text(index, args)
            for index, predicate in enumerate(self.program.predicates)
            if predicate.kind is not Kind.ACTION
            for args in held(index)
        ]
        return {"facts": facts, "open": self.machine.goals()["open"], "quiet": self.machine.quiescent}

    # ---- what happens from outside

    def hand_in(self, now: int, event: Line) -> None:
        """Let one line of the script happen."""
        machine = self.machine
        match event:
            case {"insert": text}:
                machine.insert(now, *self.fact(text))
            case {"withdraw": text}:
                machine.withdraw(now, *self.fact(text))
            case {"want": text}:
                machine.want(now, *self.read(text))
            case {"do": text}:
                origin = event.get("origin")
                machine.derive_action(now, *self.fact(text), None if origin is None else tuple(origin))
            case {"complete": serial}:
                machine.complete(now, serial, event.get("ok", True), event.get("executor"))
            case {"await": text}:
                machine.await_finish(now, event["robot"], event["assertion"], self.fact(text)[1], event["since"])
            case {"seen": text}:
                machine.finish_seen(now, event["robot"], event["assertion"], self.fact(text)[1], event["since"])

    def read(self, text: str) -> tuple[int, tuple[Value | Pattern, ...]]:
        """Return a predicate and the arguments behind the owner; a variable is ANY."""
        fact = read_fact(text)
        index = self.program.index(fact.name.text)
        assert index is not None, text
        args: list[Value | Anything] = []
        for argument in fact.arguments[1:]:
            folded = argument if isinstance(argument, Variable) else Folder({}).fold(argument)
            args.append(folded.value if isinstance(folded, Literal) else ANY)
        return index, tuple(args)

    def fact(self, text: str) -> tuple[int, tuple[Value, ...]]:
        """Return a predicate and its values."""
        index, args = self.read(text)
        return index, tuple(arg for arg in args if not isinstance(arg, Anything))  # type: ignore[misc]

    # ---- what the machine says

    def text(self, predicate: int, args: tuple[Any, ...], owner: int | None = None) -> str:
        """Return a fact in program syntax; what is free is ``_``."""
        declared = self.program.predicates[predicate]
        mark = "!" if declared.kind is Kind.PERSISTENT else ""
        if not any(isinstance(arg, Anything) for arg in args):
            return format_fact(declared.name, (Robot(self.robot if owner is None else owner), *args), mark)
        words = ["_" if isinstance(arg, Anything) else format_value(arg) for arg in args]
        return f"{mark}{declared.name}({', '.join([f'@{self.robot}', *words])})"

    def line(self, event: VmEvent) -> Line:
        """Return an event as a line of the trace, without the time."""
        match event:
            case RuleFired(rule=rule):
                return {"fired": rule}
            case FactInserted(predicate=predicate, args=args):
                return {"inserted": self.text(predicate, args)}
            case FactRemoved(predicate=predicate, args=args):
                return {"removed": self.text(predicate, args)}
            case FactSent(destination=to, predicate=predicate, args=args):
                return {"sent": self.text(predicate, args, to)}
            case GoalSent(destination=to, predicate=predicate, args=args):
                return {"sent": "?" + self.text(predicate, args, to)}
            case GoalAchieved(predicate=predicate, args=args):
                return {"achieved": self.text(predicate, args)}
            case GoalWithdrawn(predicate=predicate, args=args):
                line = {"withdrawn": self.text(predicate, args)}
                return line if event.served is None else {**line, "with": self.text(*event.served)}
            case ActionDerived() | ActionCancelled():
                return self.action(event)
            case ExpressionFailed(where=where):
                return {"failed": where}
            case RuleRepeats(rule=rule, firings=firings):
                return {"repeats": rule, "firings": firings}
            case BoundReached(what=what, bound=bound):
                return {"bound": what, "most": bound}
            case _:
                return self.timed(event)

    def action(self, event: ActionDerived | ActionCancelled) -> Line:
        """Return an event of an action."""
        if isinstance(event, ActionCancelled):
            return {"cancelled": event.serial, "with": self.text(*event.served)}
        line = {"action": self.text(event.predicate, event.args, event.executor), "serial": event.serial}
        return line if event.origin is None else {**line, "origin": list(event.origin)}

    def timed(self, event: VmEvent) -> Line:
        """Return an event of a time assertion."""
        match event:
            case JobStarted(job=job):
                return {"started": _job(job), "deadline": job.deadline}
            case JobFinished(job=job):
                return {"finished": _job(job), "finish": job.finish, "missed": job.missed}
            case JobMissed(job=job):
                return {"missed": _job(job), "deadline": job.deadline}
            case FinishAwaited():
                start = self.program.assertions[event.assertion].start.predicate
                text = self.text(start, event.start_args)
                return {"await": text, "from": event.destination, "assertion": event.assertion, "since": event.since}
            case FinishSeen():
                finish = self.program.assertions[event.assertion].finish.predicate
                text = self.text(finish, event.args)
                return {"seen": text, "to": event.destination, "assertion": event.assertion, "since": event.at}
        raise AssertionError(event)


def _job(job: TimedJob) -> str:
    return f"{job.serial} {job.name}: {job.text}"
