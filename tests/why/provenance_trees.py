"""The property of provenance trees: every leaf is given, comes from outside, or is sensed.

An item without premises is a leaf of every tree in which it stands, and premises are items again. So the property holds
of all trees if it holds of every item without premises.
"""

from rmr.why.explain import Explainer
from rmr.why.mind_index import MindIndex
from rmr.why.past import Past
from rmr.why.past_items import PastItem

LEAVES = {"given", "outside", "sensed"}


def unexplained(past: Past, mind: MindIndex, item: PastItem) -> list[str]:
    """Return the item as text if it is a leaf that it may not be, or rests on what came later."""
    explainer = Explainer(past, mind.robot)
    because = explainer.because(mind, item)
    later = [premise for premise in because.premises if premise.item.at > item.at]
    if (because.premises and not later) or (not because.premises and because.word in LEAVES):
        return []
    return [f"{explainer.text(mind, item)}: {because.words}"]
