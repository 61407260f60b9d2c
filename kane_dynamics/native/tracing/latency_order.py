"""
Order of a program in which operations that wait for others alternate with ready ones.

A processor executes operations out of order, but only within a few hundred. A step that
computes forces, then a mass matrix, then its factors waits for the end of each chain of
dependent operations, because the next chain is too far away in the program. List
scheduling (Muchnick, Advanced Compiler Design and Implementation, 17.1.2) interleaves
them: in each cycle of a model of the processor come the operations whose operands are
ready, first those with the longest chain of operations behind them.

The values live longer, so that more of them are spilled. The time of an implicit step of
elastic joints falls by a tenth with up to nine joints, and rises with ten, whose
program stays as it is; that of a Runge-Kutta step of beams falls by a twentieth. Other
quantities are mostly one chain, and gain nothing.
"""

from dataclasses import replace
from heapq import heappop, heappush
from typing import Any, TypeVar

from kane_dynamics.native.tracing.expression import Expr, operands, Trace
from kane_dynamics.native.tracing.program import Program

# Cycles from the operands to the result; about those of processors since 2020.
LATENCY = {'input': 0, 'output': 0, 'neg': 1, 'add': 3, 'sub': 3, 'mul': 3, 'div': 13,
           'sqrt': 20, 'sin': 40, 'cos': 40, 'call': 200, 'loop': 1000}
USUAL_LATENCY = 4  # of all other operations
PER_CYCLE = 3  # operations that begin in one cycle
Ordered = TypeVar('Ordered', bound=Program)
LONGEST = 3500  # operations of a program; the code of longer ones spills too much


def by_latency(program: Ordered) -> Ordered:
    """
    Return a program of the same operations in the order of list scheduling.

    A program of more than `LONGEST` operations is returned as it is.
    """
    nodes = program.schedule()
    if len(nodes) > LONGEST:
        return program
    trace = Trace()
    moved: dict[int, Expr] = {}

    def value_of(argument: Any) -> Any:
        return moved[argument.index] if isinstance(argument, Expr) else argument

    # The nodes are the same; only their order of creation is another one.
    for node in _Schedule(nodes).order():
        moved[node.index] = trace.node(node.op, *map(value_of, node.args))
    outputs = tuple(map(value_of, program.outputs))
    return replace(program, outputs=outputs, nodes=trace.close())


class _Schedule:
    """List scheduling of nodes, which are numbered by their places."""

    def __init__(self, nodes: list[Expr]) -> None:
        """Count the operands of each node, and the latency of what follows it."""
        self._nodes = nodes
        self._latency: list[int] = []
        self._operands: list[set[int]] = []
        self._users: list[list[int]] = []
        # Operands and users of each node, by their places in the order.
        place: dict[int, int] = {}
        for k, node in enumerate(nodes):
            place[node.index] = k
            self._latency.append(LATENCY.get(node.op, USUAL_LATENCY))
            self._users.append([])
            needed = {place[operand.index] for operand in operands(node)}
            self._operands.append(needed)
            for j in needed:
                self._users[j].append(k)
        # Nodes come after their operands, so that one pass from the end suffices.
        self._following = [0] * len(nodes)
        for k in reversed(range(len(nodes))):
            chain = self._following[k] + self._latency[k]
            for j in self._operands[k]:
                self._following[j] = max(self._following[j], chain)

    def order(self) -> list[Expr]:
        """Return the nodes in the order in which a processor would begin them."""
        missing = list(map(len, self._operands))  # operands that have not begun yet
        known = [0] * len(self._nodes)  # cycle from which on all operands are known

        # Heaps: nodes by the cycle in which they are ready; ready ones, the longest chain
        # behind them first.
        waiting = [(0, k) for k, count in enumerate(missing) if count == 0]
        ready: list[tuple[int, int]] = []
        result: list[Expr] = []
        cycle = 0
        while len(result) < len(self._nodes):
            while waiting and waiting[0][0] <= cycle:
                _, k = heappop(waiting)
                heappush(ready, (-self._following[k], k))
            for _ in range(min(PER_CYCLE, len(ready))):
                _, k = heappop(ready)
                result.append(self._nodes[k])
                for user in self._users[k]:
                    known[user] = max(known[user], cycle + self._latency[k])
                    missing[user] -= 1
                    if not missing[user]:
                        heappush(waiting, (known[user], user))
            cycle += 1
        return result
