"""URScript without a robot: text to a program, what it computes, and what ends it."""

import math

import pytest

from robot_emulators.ur.urscript.functions import Table
from robot_emulators.ur.urscript.machine import Machine, compiled
from robot_emulators.ur.urscript.values import ProgramEndsError, ScriptFaultError

TABLE = Table()


@TABLE.add()
def say(said, value, more=""):
    said.append(value if more == "" else (value, more))


@TABLE.add()
def sync(said):
    yield


@TABLE.add()
def ask(said, value=7):
    yield
    return value


@TABLE.add()
def struct(said, **fields):
    return dict(fields)


def run(text: str, cycles: int = 100) -> list:
    """What a program says within some control cycles."""
    said: list = []
    machine = Machine(compiled(text, TABLE), said)
    try:
        for _ in range(cycles):
            if not machine.cycle():
                return said
    except ProgramEndsError:
        return said
    raise AssertionError("it does not end")


def body(*lines: str) -> list:
    return run("def program():\n" + "\n".join(lines) + "\nend\n")


def fault(text: str) -> ScriptFaultError:
    with pytest.raises(ScriptFaultError) as caught:
        run(text)
    return caught.value


@pytest.mark.parametrize(
    "expression, value",
    [
        ("1 + 2 * 3 - 4 / 8", 6.5),
        ("7 % 4 + -7 % 4", 3 + 1),
        ("(1 + 2) * -3", -9),
        ("2 ^ 3", 8.0),
        ("1 < 2 and not 3 <= 2 or False", True),
        ("True xor True", False),
        ("not 1 == 2", True),
        ("[1, 2] + [3, 4] * 2", [7, 10]),
        ("2 * [1, 2] / 4", [0.5, 1.0]),
        ("p[1, 2, 3, 4, 5, 6][5]", 6),
        ("0x1F", 31),
        ("1.5e-3", 0.0015),
        ('"a" == "a"', True),
        ("struct(a=1, b=[2, 3]).b[1]", 3),
        ("ask(3) + ask(value=4) * ask()", 31),
    ],
)
def test_expressions(expression, value):
    assert body(f"say({expression})") == [value]


def test_the_right_side_is_looked_at_only_where_it_matters_and_halt_ends_all():
    assert body("say(False and nothing)", "say(True or nothing)") == [False, True]
    assert "nothing" in fault("say(True and nothing)\n").text
    assert body("say(1)", "halt", "say(2)") == [1]


def test_blocks_loops_and_functions_with_defaults():
    said = body(
        "def twice(x, by=2):", "  return x * by", "end",
        "i = 0",
        "while True:", "  i = i + 1",
        "  if i == 2:", "    continue", "  elif i > 4 or", "    i < 0:", "    break", "  end",
        "  say(twice(i), twice(i, by=10))", "end",
        "if i == 1:", "  say(1)", "else:", "  say(twice(i))", "end",
    )  # fmt: skip
    assert said == [(2, 10), (6, 30), (8, 40), 10]


def test_names_are_the_nearest_ones_and_lists_and_structs_are_values():
    said = body(
        "outer = 1",
        "def f():", "  outer = 2", "  inner = 3", "  global shared = 5", "end",
        "f()", "say(outer)", "say(shared)",
    )  # fmt: skip
    assert said == [2, 5]
    assert "inner" in fault("def f():\n inner = 3\nend\nf()\nsay(inner)\n").text
    said = body("a = [1, [2]]", "b = a", "b[1][0] = 9", "b[0] = 8", "say(a)", "say(b)",
                "s = struct(x=1)", "t = s", "t.x = 2", "say(s.x)", "say(t.x)")  # fmt: skip
    assert said == [[1, [2]], [8, [9]], 1, 2]
    # Squares, 60 times over: a whole number becomes floating point, and that infinite.
    said = body("x = 3", "i = 0", "while i < 60:", "  x = x * x", "  i = i + 1", "end", "say(x)")
    assert said == [math.inf]


def test_threads_run_side_by_side_are_joined_and_killed():
    said = body(
        "n = 0",
        "thread count():", "  while True:", "    n = n + 1", "    sync()", "  end", "end",
        "thread short(times):", "  k = 0", "  while k < times:", "    k = k + 1", "    sync()",
        "  end", '  say("done")', "end",
        "counter = run count()", "join run short(3)", "kill counter", "say(n)", "sync()", "sync()",
        "say(n)",
    )  # fmt: skip
    assert said[0] == "done" and said[1] == said[2] and 3 <= said[1] <= 5


@pytest.mark.parametrize(
    "text, line, column, why",
    [
        ("def f():\n  nowhere()\nend", 2, 3, "compile_error_name_not_found:nowhere:"),
        ("def f():\n  say(nobody)\nend", 2, 7, "compile_error_name_not_found:nobody:"),
        ("def f():\n  x = \nend", 3, 1, "syntax_error_on_line:3:"),
        ("def f():\n  x = 1 $ 2\nend", 2, 9, "syntax_error_on_line:2:"),
        ("def f():\n  say(1)", 3, 1, "syntax_error_on_line:3:"),
        ("def f():\n  x = [1, 2][2]\nend", 2, 13, "index 2 of a list of 2"),
        ("def f():\n  x = 1 / 0\nend", 2, 9, "division by zero"),
        ("def f():\n  x = [1] + [1, 2]\nend", 2, 11, "lists of 1 and 2"),
        ('def f():\n  if "a":\n  end\nend', 2, 3, "true or false"),
        ("def f():\n  say()\nend", 2, 3, "missing a required argument: 'value'"),
        ("def f():\n  say(1, 2, 3)\nend", 2, 3, "too many positional arguments"),
        ("def f():\n  say(1, other=2)\nend", 2, 3, "unexpected keyword argument 'other'"),
        ("def f():\n  while True:\n    x = 1\n  end\nend", 2, 3, "lacks a sync()"),
        ("def f():\n  def g():\n    g()\n  end\n  g()\nend", 2, 3, "too many calls"),
        ("def f():\n  x = p[1, 2]\nend", 2, 7, "six elements"),
        ("def f():\n  thread t():\n    while True:\n      sync()\n    end\n  end\n"
         "  while True:\n    run t()\n  end\nend", 8, 5, "50 threads"),
    ],
    ids=range(16),
)  # fmt: skip
def test_what_is_wrong_has_a_place(text, line, column, why):
    found = fault(text + "\n")
    assert why in found.text and (found.line, found.column) == (line, column)


@pytest.mark.parametrize(
    "text",
    ["x = " + "(" * 3000, "x = " + "[" * 3000, "x = " + "-" * 3000 + "1", "x = 1" + " + 1" * 30000,
     "if True:\n" * 3000, "x = " + "9" * 400, "x" * 300_000],
    ids=range(7),
)  # fmt: skip
def test_texts_without_measure_are_refused(text):
    assert fault(text + "\n").text
