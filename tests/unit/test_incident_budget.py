"""A cause that comes again and again leaves room for incidents of others."""

from ecatd.recorder.budget import Budget


def test_a_storm_leaves_room_for_another_cause() -> None:
    budget = Budget(12)
    taken = [second for second in range(3600) if not budget.take("late frames", float(second))]
    assert taken == [0, 1, 121, 361, 841, 1801], "the pause is twice as long each time"
    assert budget.take("slave 5 is lost", 3599.0) == ""
    assert "cause" in budget.take("late frames", 3599.5)


def test_repeated_causes_share_half_of_the_hour() -> None:
    budget = Budget(4)
    assert budget.take("a", 0) == budget.take("a", 180) == budget.take("a", 540) == ""
    assert "causes that had one already" in budget.take("a", 3000)
    assert budget.take("b", 3000) == ""
    assert "4 incidents" in budget.take("c", 3001)
    assert budget.take("c", 3601) == "", "the first one is an hour old"
