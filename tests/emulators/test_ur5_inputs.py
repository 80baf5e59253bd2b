"""Which packet counts in which cycle, also where an emulator was held up and hears many at once."""

from robot_emulators.ur.inputs import Inputs
from robot_emulators.ur.packets import inputs

CB3 = (3, 15, 8, 106339)
NAME = "input_int_register_1"


def held_up() -> tuple[Inputs, list[int]]:
    """Inputs whose cycle had its deadline at 1.000 s; what they took."""
    taken: list[int] = []
    made = Inputs(inputs(CB3), lambda values: taken.append(int(values[NAME][0])))
    made.cycle(0.992, due=1.000)
    return made, taken


def test_in_time_the_newest_of_a_cycles_packets_counts():
    made, taken = held_up()
    for k in range(3):
        made.write("robot", {NAME: (k,)}, 0.999)
    assert taken == [0, 1, 2]
    assert made.values[NAME] == (2,)


def test_late_one_packet_of_each_client_is_taken_a_cycle():
    made, taken = held_up()
    for k in range(4):
        made.write("robot", {NAME: (k,)}, 1.030)
    made.write("gripper", {NAME: (70,)}, 1.030)
    assert taken == [0, 70]
    made.cycle(1.031, due=1.008)
    made.cycle(1.032, due=1.016)
    assert taken == [0, 70, 1, 2]
    made.write("robot", {NAME: (4,)}, 1.033)
    assert taken == [0, 70, 1, 2]
    assert made.at[NAME] == 1.032
    made.cycle(1.034, due=1.040)
    assert taken == [0, 70, 1, 2, 3, 4]
    made.write("robot", {NAME: (5,)}, 1.035)
    assert made.values[NAME] == (5,)


def test_a_client_that_hangs_up_is_heard_to_the_end():
    made, taken = held_up()
    for k in range(3):
        made.write("robot", {NAME: (k,)}, 1.030)
    made.release("robot")
    assert taken == [0, 1, 2]
    made.cycle(1.031, due=1.008)
    assert taken == [0, 1, 2]


def test_what_waits_is_bounded_and_nothing_of_it_is_lost():
    made, taken = held_up()
    for k in range(1000):
        made.write("robot", {NAME: (k,)}, 1.030)
    assert taken == list(range(len(taken)))
    assert len(taken) >= 1000 - 256


def test_after_switching_on_nothing_waits():
    made, taken = held_up()
    made.write("robot", {NAME: (1,)}, 1.030)
    made.write("robot", {NAME: (2,)}, 1.030)
    made.clear()
    made.cycle(1.031, due=1.008)
    assert taken == [1]
    assert made.values[NAME] == (0,)
