"""Programs on the UR emulator: what moves, what is asked over sockets, what can be loaded."""

import ast
import gzip
import socket
import struct
import time

import numpy as np
import pytest

from robot_emulators.kinematic_plant import kinematic_plant
from robot_emulators.plant import PlantRequest
from robot_emulators.ur import messages, program_files
from robot_emulators.ur.messages import Event
from robot_emulators.ur.modes import Runtime
from robot_emulators.ur.program_files import ProgramFileError
from robot_emulators.ur.urscript.tokens import Collector, is_secondary
from ur5_bench import CYCLE, Bench

HOST = "127.0.1.34"
LOOK = "thread look():\n sleep(0.1)\n textmsg(get_target_waypoint())\nend"
ASIDE, UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Played(Bench):
    def __init__(self, series: str = "cb3", **settings: str) -> None:
        super().__init__(series=series, **settings)
        self.said: list[str] = []
        self.faults: list[Event] = []
        self.controller.announce = self._hear

    def _hear(self, event) -> None:
        if event.kind == messages.SAID:
            self.said.append(event.text)
        if event.kind == messages.FAULT:
            self.faults.append(event)

    def play(self, *lines: str, seconds: float = 0.1) -> "Played":
        text = "def program():\n" + "\n".join(lines) + "\nend\nrun program\n"
        self.controller.upload(Collector().feed(text.encode()))
        self.run(seconds)
        return self

    @property
    def waypoint(self) -> object:
        return pytest.approx(ast.literal_eval(self.said[-1][1:]), abs=1e-5)

    @property
    def plays(self) -> bool:
        return self.controller.modes.runtime is Runtime.PLAYING


@pytest.fixture
def bench():
    return Played()


def q_text(q) -> str:
    return "[" + ", ".join(f"{v:.9f}" for v in q) + "]"


def p_text(pose) -> str:
    return "p" + q_text(pose)


def test_moves_end_where_they_should_and_take_their_time(bench):
    home, goal = bench.arm.q.copy(), bench.arm.q + 0.2
    bench.play(f"movej({q_text(goal)}, a=2, v=1)", 'textmsg("there")', seconds=0.5)
    assert bench.plays and not bench.said
    bench.run(0.5)
    assert bench.said == ["there"] and not bench.plays and np.abs(bench.arm.q - goal).max() < 1e-9
    bench.play(LOOK, "run look()", f"movej({q_text(home)}, t=1.2)", seconds=1.16)
    assert bench.plays and bench.waypoint == bench.arm.kinematics.pose(home, bench.arm.tcp)
    bench.run(0.1)
    assert not bench.plays and np.abs(bench.arm.q - home).max() < 1e-9
    goal = bench.arm.q + np.array([2.4, 0, 0, 0, 0, 0])
    way = np.array(bench.play(f"movej({q_text(goal)}, t=0.1)", seconds=0.0).run(2.0))
    assert np.abs(bench.arm.q - goal).max() < 1e-9 and not bench.faults
    top = bench.arm.kinematics.speed[0]
    assert 0.8 * top < np.abs(np.diff(way[:, 0])).max() / CYCLE <= top


def test_straight_moves_and_circles_keep_their_way(bench):
    kinematics, tcp = bench.arm.kinematics, bench.arm.tcp
    start = kinematics.pose(bench.arm.q, tcp)
    to = start + np.array([0.0, 0.1, -0.05, 0.0, 0.0, 0.0])
    way = bench.play(LOOK, "run look()", f"movel({p_text(to)}, v=0.5)", seconds=0.0).run(2.0)
    assert bench.waypoint == to
    spots = np.array([kinematics.pose(q, tcp)[:3] for q in way])
    line = (to - start)[:3] / np.linalg.norm((to - start)[:3])
    off = (spots - start[:3]) - np.outer((spots - start[:3]) @ line, line)
    assert np.abs(off).max() < 1e-5 and np.abs(spots[-1] - to[:3]).max() < 1e-5
    centre = to[:3] + np.array([0.0, -0.05, 0.0])
    via, last = to.copy(), to.copy()
    via[:3], last[:3] = centre + 0.05 * UP, centre - 0.05 * ASIDE
    way = bench.play(f"movec({p_text(via)}, {p_text(last)}, v=0.2)", seconds=0.0).run(3.0)
    spots = np.array([kinematics.pose(q, tcp)[:3] for q in way])
    assert np.abs(np.linalg.norm(spots - centre, axis=1) - 0.05).max() < 1e-5
    assert np.abs(spots[-1] - last[:3]).max() < 1e-5
    assert spots[:, 2].max() == pytest.approx(centre[2] + 0.05, abs=1e-4)


def test_one_thread_moves_the_arm_and_a_killed_one_lets_it_brake(bench):
    goal = q_text(bench.arm.q + 0.3)
    bench.play(f"thread t():\n movej({goal})\nend", "run t()", "sync()", f"movej({goal})")
    assert "another thread" in bench.faults[0].text and not bench.plays
    bench.run(1.0)
    assert not bench.arm.moving
    bench = Played()
    goal = q_text(bench.arm.q + 0.8)
    bench.play(f"thread t():\n movej({goal})\nend", "h = run t()", "sleep(0.5)", "kill h",
               "sleep(1)", 'textmsg("", is_steady())', seconds=1.7)  # fmt: skip
    assert bench.said == ["True"] and not bench.faults


def test_goals_and_functions_that_there_are_not(bench):
    bench.play("movej(p[10, 0, 0, 0, 0, 0])")
    assert "no solution" in bench.faults[0].text
    bench.play("movej([0, 0, 0, 0, 0, 20])")
    assert "limits" in bench.faults[1].text and not bench.controller.modes.protective
    assert bench.play("movel(p[10, 0, 0, 0, 0, 0])").controller.modes.protective
    assert not Played("e", software="5.23.0").play("direct_torque([0, 0, 0, 0, 0, 0])").faults
    other = Played("e").play("direct_torque([0, 0, 0, 0, 0, 0])")
    assert other.faults[0].text == "compile_error_name_not_found:direct_torque:"


def test_dynamics_are_those_of_the_point_that_the_plant_carries():
    """By differences of where the point is, which knows no Jacobian."""
    plant = kinematic_plant(PlantRequest("ur5", CYCLE))
    played, load = Played("e", software="5.23.0"), plant.arm.payload
    played.arm.plant = plant
    q, qd = np.array([0.3, -1.2, 1.1, -0.4, 0.9, 0.2]), np.array([0.5, -0.3, 0.8, 0.2, -0.6, 1.0])
    tool, step = [*load.cog, 0.0, 0.0, 0.0], 1e-4
    played.play(f"q = {q_text(q)}", f"qd = {q_text(qd)}", f"tool = {p_text(tool)}",
                "m = get_mass_matrix(q)", "textmsg(m)", "textmsg(get_jacobian(q, tool))",
                "textmsg(get_jacobian_time_derivative(q, qd, tool))",
                "textmsg(get_coriolis_and_centrifugal_torques(q, qd))",
                "textmsg(m[1, 2] == m[2][1])", "m[0, 1] = 7", "textmsg(m[0][1])",
                "textmsg(get_target_joint_accelerations())")  # fmt: skip

    def place(joints):
        return played.arm.kinematics.transform(joints, np.array(tool))[1]

    def lever(joints):
        moved = [(place(joints + step * e) - place(joints - step * e)) for e in np.eye(6)]
        return np.transpose(moved) / (2 * step)

    mass, jacobian, rate, torques = (ast.literal_eval(text) for text in played.said[:4])
    along = lever(q)
    turning = (place(q + step * qd) - 2 * place(q) + place(q - step * qd)) / step**2
    assert np.array(mass) == pytest.approx(load.mass * along.T @ along, abs=2e-6)
    assert np.array(jacobian)[:3] == pytest.approx(along, abs=2e-6)
    assert np.array(rate)[:3] @ qd == pytest.approx(turning, abs=1e-5)
    assert torques == pytest.approx(load.mass * along.T @ turning, abs=1e-5)
    assert played.said[4:] == ["True", "7", "[0, 0, 0, 0, 0, 0]"]


def test_registers_state_and_poses(bench):
    bench.write(i3=42, d5=2.5)
    bench.play(
        "write_output_integer_register(4, read_input_integer_register(3) + 1)",
        "write_output_float_register(6, read_input_float_register(5) * 2)",
        "set_tcp(p[0, 0, 0.1, 0, 0, 0])",
        "a = get_actual_tcp_pose()",
        "b = pose_sub(a, get_actual_tool_flange_pose())", "textmsg(norm([b[0], b[1], b[2]]))",
        "b = pose_trans(a, p[0, 0, 0, 0, 0, 0])", "b = pose_sub(a, b)",
        "textmsg(norm([b[0], b[1], b[2], b[3], b[4], b[5]]) < 0.000001)",
        "textmsg(norm(get_inverse_kin(get_forward_kin()) - get_actual_joint_positions()) < 0.0001)",
        "set_payload(1.5, [0, 0, 0.05])", "textmsg(get_target_payload())",
    )  # fmt: skip
    assert bench.said == ["0.1", "True", "True", "1.5"] and not bench.faults
    values = bench.controller.values
    assert values["output_int_register_4"] == (43,)
    assert values["output_double_register_6"] == (5.0,)


def test_the_first_64_bit_registers_share_words_and_the_others_stand_alone(bench):
    bench.controller.inputs.write({"input_bit_registers32_to_63": (1 << 8,)}, bench.now)
    bench.play(
        "write_output_boolean_register(3, True)", "write_output_boolean_register(33, True)",
        "write_output_boolean_register(64, True)", "write_output_boolean_register(33, False)",
        "textmsg(read_output_boolean_register(3), read_output_boolean_register(33))",
        "textmsg(read_input_boolean_register(40), read_input_boolean_register(41))",
        "write_output_boolean_register(128, True)",
    )  # fmt: skip
    assert bench.said == ["TrueFalse", "TrueFalse"]
    values = bench.controller.values
    assert values["output_bit_registers0_to_31"] == (1 << 3,)
    assert values["output_bit_register_64"] == (True,)
    assert "no output_bit_register_128" in bench.faults[0].text


def test_a_watchdog_pauses_a_program_whose_input_is_not_written(bench):
    bench.play('rtde_set_watchdog("input_int_register_0", 10, "PAUSE")',
               "while True:", "  sync()", "end", seconds=0.0)  # fmt: skip
    for k in range(20):
        bench.write(i0=k)
        bench.run(0.05)
    assert bench.plays
    bench.run(0.2)
    assert bench.controller.modes.runtime is Runtime.PAUSED


def test_a_popup_waits_and_a_secondary_program_runs_beside(bench):
    bench.play('popup("well?", blocking=True)', 'textmsg("closed")')
    assert bench.plays and not bench.said
    bench.controller.popup = False
    bench.run(2 * CYCLE)
    assert bench.said == ["closed"]
    bench.play("while True:", "  sync()", "end")
    bench.controller.upload(Collector().feed(b"sec s():\n set_digital_out(3, True)\nend\n"))
    bench.run(CYCLE)
    assert bench.controller.terminals.bits == 1 << 3 and bench.plays


def _long(*lines: str) -> list:
    text = "\n".join(["def program():", *["k = 1"] * 2000, *lines, "end", ""])
    return Collector().feed(text.encode())


def _until(bench, holds, seconds: float = 20.0) -> None:
    """Take cycles in real time until something holds."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        bench.run(CYCLE)
        time.sleep(CYCLE)


def test_the_control_cycle_goes_on_while_a_long_program_is_compiled(bench):
    bench.controller.upload(_long('textmsg("compiled")', "while True:", "  sync()", "end"))
    bench.run(CYCLE)
    assert not bench.said and not bench.plays
    _until(bench, lambda: bench.plays)
    bench.run(CYCLE)
    assert bench.said == ["compiled"]


@pytest.mark.parametrize("instead", ["stop", "short"])
def test_what_comes_while_a_program_is_compiled_takes_its_place(bench, instead):
    bench.controller.upload(_long('textmsg("first")'))
    if instead == "stop":
        bench.controller.stop_program()
    else:
        bench.play('textmsg("second")')
    time.sleep(0.3)  # until it is compiled
    bench.run(0.5)
    assert bench.said == ([] if instead == "stop" else ["second"])


def test_sockets_read_what_a_computer_sends(bench):
    with socket.create_server((HOST, 0)) as server:
        port = server.getsockname()[1]
        bench.play(f'textmsg("", socket_open("{HOST}", {port}, "s"))',
                   'textmsg("", socket_read_binary_integer(3, "s", 5))',
                   'textmsg(socket_read_line("s"))', 'textmsg(socket_get_var("depth", "s"))',
                   'socket_send_int(-2, "s")', 'textmsg("", socket_read_line("s", 0.1) == "")',
                   'socket_close("s")', 'textmsg("", socket_send_int(1, "s"))')  # fmt: skip
        server.settimeout(2.0)
        peer, _ = server.accept()
        with peer:
            peer.settimeout(2.0)
            peer.sendall(struct.pack(">2i", 1, -5))
            bench.run(0.05)
            peer.sendall(struct.pack(">i", 7) + b"a line\n")
            bench.run(0.05)
            assert peer.recv(100) == b"GET depth\n"
            peer.sendall(b"depth 12\n")
            bench.run(0.05)
            assert peer.recv(4) == struct.pack(">i", -2)
            bench.run(0.3)
            assert peer.recv(1) == b""
    assert bench.said == ["True", "[3, 1, -5, 7]", "a line", "12", "True", "False"]
    assert not bench.faults and not bench.plays


def test_nobody_answers_a_socket(bench):
    with socket.create_server((HOST, 0)) as server:
        port = server.getsockname()[1]
    bench.play(f'textmsg("", socket_open("{HOST}", {port}))', 'textmsg("", socket_open("pc", 1))',
               'textmsg("", socket_read_binary_integer(1)[0])')  # fmt: skip
    assert bench.said == ["False", "False", "0"] and not bench.plays
    bench.play("while True:", '  x = socket_read_binary_integer(4, "none", 0)', "end", seconds=1.0)
    assert bench.plays and not bench.faults


def test_scripts_are_separate_programs_and_an_endless_one_is_refused():
    collector = Collector()
    text = b"# words\n\nstopj(2)\nsec s():\n  set_digital_out(0, True)\nend\n"
    assert [is_secondary(one) for one in collector.feed(text)] == [False, True]
    text = "def f():\n write_output_integer_register(0 +24, 2)\nend\n"
    assert collector.feed(text.encode()) == [text]
    collector = Collector()
    collector.feed(b"def f():\n")
    assert any(collector.feed(b"x = 1\n" * 20000) is None for _ in range(60))


EXTERNAL = b'textmsg("from the computer")\nwhile True:\n  sync()\nend\n# NODE_CONTROL_LOOP_ENDS\n'


def test_external_control_asks_the_computer_for_its_program():
    with socket.create_server((HOST, 0)) as server:
        bench = Played(external_control=f"{HOST}:{server.getsockname()[1]}")
        assert bench.controller.load("external_control.urp") and bench.controller.play()
        bench.run(0.05)
        server.settimeout(2.0)
        peer, _ = server.accept()
        with peer:
            peer.settimeout(2.0)
            bench.run(0.05)
            assert peer.recv(100) == b"request_program\n"
            peer.sendall(EXTERNAL)
            bench.run(0.1)
    assert bench.said == ["from the computer"] and bench.plays
    assert bench.controller.play() is False


def test_without_a_computer_external_control_ends_with_its_reason():
    with socket.create_server((HOST, 0)) as server:
        port = server.getsockname()[1]
    bench = Played(external_control=f"{HOST}:{port}")
    assert bench.controller.load("external_control.urp") and bench.controller.play()
    bench.run(0.1)
    assert f"{HOST}:{port}" in bench.faults[0].text and not bench.plays


def node(tag: str, inside: str = "", **attributes: str) -> str:
    written = " ".join(f'{k}="{v}"' for k, v in attributes.items())
    return f"<{tag} {written}>{inside}</{tag}>"


def words(text: str) -> str:
    return node("expression", "".join(node("ExpressionChar", character=c) for c in text))


def urp(*nodes: str, before: str = "", once: str = "true") -> bytes:
    main = node("MainProgram", f"<children>{''.join(nodes)}</children>", runOnlyOnce=once)
    first = node("SpecialSequence", f"<children>{before}</children>", type="BeforeStart")
    return node("URProgram", f"<children>{first}{main}</children>", name="made here").encode()


PLACE = "../../../../../../SpecialSequence/children/Assignment/variable"
ASSIGNED = node("Assignment", node("variable", name="goal") + words("3"))
SHOWN = node("Script", words("textmsg(goal)"), type="Line")


def test_a_tree_with_variables_loops_and_conditions_becomes_a_program(tmp_path):
    """Of such nodes is the program of the maker's RTDE examples, rtde_control_loop.urp."""
    variable = node("ExpressionVariable", node("ProgramVariable", reference=PLACE))
    condition = f"<expression>{variable}{node('ExpressionChar', character='≟')}" + (
        node("ExpressionChar", character="3") + "</expression>"
    )
    chosen = node("If", f"{condition}<children>{SHOWN}</children>", type="If")
    (tmp_path / "made.urp").write_bytes(gzip.compress(urp(chosen, before=ASSIGNED)))
    bench = Played(programs=str(tmp_path))
    assert bench.controller.load("/programs/made.urp") and bench.controller.play()
    bench.run(0.3)
    assert bench.said == ["3"]


def test_a_tree_of_nodes_becomes_a_program_if_it_is_in_the_folder(tmp_path):
    (tmp_path / "inside").mkdir()
    assert program_files.load(tmp_path / "inside", "../made.urp") is None
    shown = node("Script", '<cachedContents>textmsg("3")</cachedContents>', type="File")
    wait = node("Wait", "<waitTime>0.5</waitTime>", type="Sleep")
    (tmp_path / "made.urp").write_bytes(gzip.compress(urp(node("Comment"), shown, wait)))
    bench = Played(programs=str(tmp_path))
    assert bench.controller.load("/programs/made.urp") and bench.controller.play()
    bench.run(0.3)
    assert bench.said == ["3"] and bench.plays
    bench.run(0.3)
    assert not bench.plays and not bench.faults


@pytest.mark.parametrize(
    "name, data, why",
    [
        ("a.urp", urp(node("Screwdriving", type="x")), "a node Screwdriving x is not known"),
        ("a.urp", b"<URProgram>", "a.urp: "),
        ("a.urp", b'<!DOCTYPE x [<!ENTITY a "b">]><URProgram/>', "not the XML of a program"),
        ("a.urp", b"\x1f\x8bnothing", "a.urp: "),
        ("a.txt", b"", "neither .urp nor .script"),
        ("a.script", b"x" * 300_000, "longer than"),
    ],
)
def test_files_that_are_no_programs_are_refused(tmp_path, name, data, why):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ProgramFileError, match=why):
        program_files.load(tmp_path, name)
