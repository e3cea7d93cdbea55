"""Explanation of rules over several robots: the home, what is asked of whom, and what a firing costs."""

from dataclasses import dataclass

from rmr.lang.explain.texts import Spot, Texts
from rmr.lang.lower.joint_plan import JointClass, JointPlan, RemotePart

FRAMES = (0, 2, 5, 10)
"""Frames of a firing by the number of robots that decide: offer and answer; for each that reserves the reservation, its
answer and the decision; and if two reserve, for each the word that all know the decision."""


@dataclass(frozen=True, slots=True)
class ExplainedRemote:
    """What a rule asks of another robot."""

    robot: str
    told: bool
    """Whether the robot tells persistent facts; else it decides about an offer."""
    facts: tuple[str, ...]
    """The atoms that the robot matches, `not` included."""
    link: str | None
    """The atom that names the robot; None for a constant, or if the robot is computed."""
    inverted: bool
    """Whether the link is the robot's own fact, which names the home."""
    why: str
    """Why the facts are not told; empty if they are."""


@dataclass(frozen=True, slots=True)
class ExplainedEnsemble:
    """A rule over several robots."""

    place: Spot
    text: str
    home: str
    remotes: tuple[ExplainedRemote, ...]
    frames: int
    """Frames of a firing without loss, acknowledgements and facts of the head for others not counted."""
    frames_told: int
    """Frames for each match that a robot tells."""
    not_home: tuple[tuple[str, str], ...]
    """Other owners, each with why it is not the home."""


def explain_ensemble(plan: JointPlan, texts: Texts) -> ExplainedEnsemble:
    """Explain one rule."""
    return ExplainedEnsemble(
        place=texts.spot(plan.rule.span),
        text=texts.line(plan.rule.span),
        home=texts.line(plan.home.span),
        remotes=tuple([_remote(each, texts) for each in plan.remotes]),
        frames=FRAMES[len(plan.offered)],
        frames_told=int(bool(plan.told)),
        not_home=tuple([(who.strip("`"), why.replace("`", "")) for who, why in plan.others]),
    )


def _remote(part: RemotePart, texts: Texts) -> ExplainedRemote:
    link = part.link or part.inverted
    return ExplainedRemote(
        robot=texts.line(part.owner.span),
        told=part.kind is JointClass.TOLD,
        facts=tuple([texts.line(each.span) for each in (*part.facts, *part.absent)]),
        link=None if link is None else texts.line(link.span),
        inverted=part.link is None and part.inverted is not None,
        why=part.rejected.replace("`", ""),
    )
