"""The tree of a program: what URScript has, frozen, each node with its place in the text."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Node:
    """Anything; line and column from 1."""

    line: int
    column: int


@dataclass(frozen=True, slots=True)
class Literal(Node):
    """A number, a truth value or a text."""

    value: float | int | bool | str


@dataclass(frozen=True, slots=True)
class Name(Node):
    """A variable's value."""

    name: str


@dataclass(frozen=True, slots=True)
class ListOf(Node):
    """``[a, b]`` or, as a pose, ``p[a, b, …]``."""

    items: tuple["Expression", ...]
    pose: bool


@dataclass(frozen=True, slots=True)
class Unary(Node):
    """``not``, ``-`` or ``+`` before an operand."""

    operator: str
    operand: "Expression"


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """An operator between two operands."""

    operator: str
    left: "Expression"
    right: "Expression"


@dataclass(frozen=True, slots=True)
class Index(Node):
    """``target[at]``."""

    target: "Expression"
    at: "Expression"


@dataclass(frozen=True, slots=True)
class Member(Node):
    """``target.name`` of a struct."""

    target: "Expression"
    name: str


@dataclass(frozen=True, slots=True)
class Call(Node):
    """A call by place and by name."""

    name: str
    places: tuple["Expression", ...]
    names: tuple[tuple[str, "Expression"], ...]


@dataclass(frozen=True, slots=True)
class Run(Node):
    """``run call()``: a new thread; its value is the thread's number."""

    call: Call


Expression = Literal | Name | ListOf | Unary | Binary | Index | Member | Call | Run


@dataclass(frozen=True, slots=True)
class Assign(Node):
    """``scope target = value``; scope is ``global``, ``local`` or empty."""

    scope: str
    target: Name | Index | Member
    value: Expression


@dataclass(frozen=True, slots=True)
class Evaluate(Node):
    """An expression whose value nobody takes."""

    value: Expression


@dataclass(frozen=True, slots=True)
class If(Node):
    """Conditions with their blocks, and what else."""

    branches: tuple[tuple[Expression, "Block"], ...]
    otherwise: "Block"


@dataclass(frozen=True, slots=True)
class While(Node):
    """A loop."""

    condition: Expression
    body: "Block"


@dataclass(frozen=True, slots=True)
class Return(Node):
    """``return value``."""

    value: Expression | None


@dataclass(frozen=True, slots=True)
class Leave(Node):
    """``break``, ``continue`` or ``halt``."""

    how: str


@dataclass(frozen=True, slots=True)
class ThreadEnd(Node):
    """``kill`` or ``join`` of a thread."""

    how: str
    thread: Expression


@dataclass(frozen=True, slots=True)
class Function(Node):
    """``def``, ``sec`` or ``thread``; parameters with their defaults, None without one."""

    kind: str
    name: str
    parameters: tuple[tuple[str, Expression | None], ...]
    body: "Block"


Statement = Assign | Evaluate | If | While | Return | Leave | ThreadEnd | Function
Block = tuple[Statement, ...]
