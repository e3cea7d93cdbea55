"""No import circles: imports under `if TYPE_CHECKING` and inside functions count like all others."""

from collections.abc import Iterator

from source_tree import modules, own_module

HOSTS = {"rmr.eval", "rmr.mind", "rmr_agent", "rmr_sim"}
"""Parts that make nodes; nothing else imports `rmr.node.node`."""


def imports() -> dict[str, list[str]]:
    """Return what each module imports of the distribution."""
    return {
        module.name: sorted({own for name in module.imports if (own := own_module(name)) and own != module.name})
        for module in modules()
    }


def circles(graph: dict[str, list[str]]) -> Iterator[frozenset[str]]:
    """Yield the strongly connected components of more than one node (Tarjan, SIAM J. Comput. 1, 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []

    def visit(node: str) -> Iterator[frozenset[str]]:
        index[node] = low[node] = len(index)
        stack.append(node)
        for successor in graph[node]:
            if successor not in index:
                yield from visit(successor)
                low[node] = min(low[node], low[successor])
            elif successor in stack:
                low[node] = min(low[node], index[successor])
        if low[node] == index[node]:
            component = frozenset(stack[stack.index(node) :])
            del stack[stack.index(node) :]
            if len(component) > 1:
                yield component

    for start in graph:
        if start not in index:
            yield from visit(start)


def test_a_circle_is_found_whatever_its_length():
    assert list(circles({"a": ["b"], "b": ["c"], "c": ["a", "d"], "d": []})) == [frozenset("abc")]
    assert list(circles({"a": ["b", "c"], "b": ["c"], "c": []})) == []


def test_no_modules_import_each_other_in_a_circle():
    found = set(circles(imports()))
    assert [sorted(circle) for circle in found] == []


def test_imports_for_type_checking_and_inside_functions_are_counted():
    graph = imports()
    assert "rmr.node.peers.perception" in graph["rmr.node.actions.handle"], "under TYPE_CHECKING"
    assert "rmr_agent.agent_process" in graph["rmr_agent.main"], "inside a function"


def test_nothing_but_hosts_imports_the_node():
    importers = {module for module, imported in imports().items() if "rmr.node.node" in imported}
    parts = {".".join(name.split(".")[:2]) if name.startswith("rmr.") else name.split(".")[0] for name in importers}
    assert parts == HOSTS
