"""Contacts by currents: found in time, once per contact, and never below half of what is one."""

import math

import pytest

from contid.errors import BadInputError
from contid.hal import Sample
from contid.robot_file.load import load_named, parse_robot_file
from contid_contact.current_contact import WITHIN_S, CurrentContact

RATE_HZ, USUAL_A, CONTACT_A = 200.0, 0.06, 0.1


def sample(effort, valid=True):
    return Sample(0.0, 0.0, valid, 0.0, effort=effort)


def found_after(current_a, seconds=2.0):
    """Time after which a current is a contact, None for never."""
    detector = CurrentContact(1, USUAL_A, CONTACT_A, 1.0 / RATE_HZ)
    for k in range(200):
        assert detector.tick([sample(0.04 * (-1.0) ** k)]) is None
    for k in range(round(seconds * RATE_HZ)):
        if detector.tick([sample(current_a)]) is not None:
            return (k + 1) / RATE_HZ
    return None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_contact_is_found_in_time_and_a_harder_one_earlier(sign):
    usual = found_after(sign * (USUAL_A + CONTACT_A))
    harder = found_after(sign * (USUAL_A + 3.0 * CONTACT_A))
    assert usual == pytest.approx(WITHIN_S, abs=2.0 / RATE_HZ)
    assert harder < 0.5 * usual
    assert found_after(sign * (USUAL_A + 0.49 * CONTACT_A)) is None


def test_it_is_found_again_only_after_it_ended():
    detector = CurrentContact(2, USUAL_A, CONTACT_A, 1.0 / RATE_HZ)
    pushing, free = [sample(0.04), sample(0.4)], [sample(0.04), sample(-0.05)]
    found = [each for each in (detector.tick(pushing) for _ in range(400)) if each is not None]
    assert len(found) == 1
    assert found[0].axes == (1,)
    assert found[0].excess_a == pytest.approx(0.34)
    assert all(detector.tick(free) is None for _ in range(40))
    assert any(detector.tick(pushing) is not None for _ in range(20))


def test_samples_without_a_current_are_left_out():
    detector = CurrentContact(1, USUAL_A, CONTACT_A, 1.0 / RATE_HZ)
    assert all(detector.tick([sample(None)]) is None for _ in range(100))
    assert all(detector.tick([sample(1.0, valid=False)]) is None for _ in range(100))


def test_the_confidence_is_that_of_the_usual_current():
    quiet, noisy = (CurrentContact(1, 0.2, 0.1, 1.0 / RATE_HZ) for _ in range(2))
    for k in range(4000):
        quiet.tick([sample(0.04)])
        noisy.tick([sample(0.1 + 0.1 * math.sin(0.3 * k))])
    first, second = (
        next(each for each in (detector.tick([sample(0.32)]) for _ in range(50)) if each is not None)
        for detector in (quiet, noisy)
    )
    assert first.confidence == pytest.approx(1.0)
    assert second.confidence < first.confidence


def test_the_keys_of_a_finger_are_checked():
    text = load_named("hand").text
    old = "    rest_mm: [60, 60]\n"
    assert old in text
    good = old + "    sense: {contact: hold, usual_ma: 60, contact_ma: 100}\n"
    parse_robot_file(text.replace(old, good, 1), "hand.yaml")
    broken = good.replace("contact_ma", "contact_mA")
    with pytest.raises(BadInputError, match=r"hand.yaml:\d+.*contact_mA.*contact_ma"):
        parse_robot_file(text.replace(old, broken, 1), "hand.yaml")
