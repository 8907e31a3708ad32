"""What the model of the trunk's tip leaves over, how much of it comes again, and a recurrent network beside.

``CONTID_SHARED_DATA=.. python -m studies.moving.trunk_left_over`` prints it; the network needs PyTorch
(``pip install torch==2.13.0``) and is left out without it.

Recordings as in `studies.moving.trunk_motion`. The split: all of it is inside the first 70 % of the
recordings with 0 and 100 g, which have the same commands; each of five parts of 21 s is predicted by a fit to
the four others. Only the network is judged on the last 27 %, once: gated recurrent units, 48 of them,
commands at 25 Hz, 1500 steps of Adam, three seeds averaged; chosen among two GRUs and two temporal
convolutions by the last fifth of the fitted rows.

What is alike in the errors with 0 and 100 g follows from the commands: a better model could have it. What is
not alike did not come again, and no model of commands alone can have it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final

import numpy as np
from scipy.signal import butter, csd, sosfiltfilt, welch

from contid.kinematics.array import Array
from contid_identify.answer import CommandedTrace
from contid_identify.tip_fit.trace_rows import LoadedTrace
from contid_identify.tip_motion_fit import fit_tip_motion
from studies.moving.recordings import PERIOD_S
from studies.moving.trunk_motion import AXES, FITTED, JUDGED, recording, sections_of, statics_of, trunk_of

PARTS: Final = 5
BANDS_HZ: Final = (0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 50.0)
WINDOW: Final = 1024
#: What rings after turns of the commands is sought in this band [Hz], until so long after [s].
RINGS_HZ: Final = (1.2, 4.0)
AFTER_S: Final = 1.0
#: The network: units, steps, rows of a batch, rows of a window and of those its beginning that do not count.
UNITS, STEPS, BATCH, ROWS, BEGIN = 48, 1500, 16, 150, 50
EVERY: Final = 4
SEEDS: Final = 3
NOISE: Final = 0.1


def left_over(grams: int) -> Array:
    """Errors ``(rows, 3)`` [mm] of the fitted part, each by a fit to the others."""
    sent, tip = recording(grams)
    count = int(FITTED * len(tip))
    at_s = np.arange(float(count)) * PERIOD_S
    ends = np.linspace(0, count, PARTS + 1).astype(int).tolist()
    trunk, out = trunk_of(0, FITTED), np.empty((count, 3))
    for first, last in pairwise(ends):
        traces = [
            LoadedTrace(CommandedTrace(PERIOD_S, sent, at_s[own], tip[own]))
            for own in (slice(0, first), slice(last, count))
            if own.stop > own.start
        ]
        model = fit_tip_motion("trunk", AXES, traces, statics_of(trunk), "", sections_of(trunk))
        predicted = model.predict(sent, PERIOD_S, at_s[first:last])
        out[first:last] = 1e3 * (tip[first:last] - predicted)
    return out


def rms(errors: Array) -> float:
    """Of distances."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def comes_again(errors: Array, others: Array) -> Iterator[str]:
    """Power of the errors in bands, and its part that both have."""
    given = {"fs": 1.0 / PERIOD_S, "nperseg": WINDOW, "axis": 0}
    hz, own = welch(errors, **given)
    _, other = welch(others, **given)
    _, both = csd(errors, others, **given)
    rest = 0.0
    for low, high in pairwise(BANDS_HZ):
        band = (hz >= low) & (hz < high)
        power = own[band].sum(axis=0)
        alike = np.abs(both[band].sum(axis=0)) / np.sqrt(power * other[band].sum(axis=0))
        size, apart = hz[1] * power.sum(), hz[1] * (power * (1.0 - alike)).sum()
        rest += apart
        yield f"  {low:4.1f} to {high:4.1f} Hz: {size:5.1f} mm^2, {1.0 - apart / size:.2f} of it come again"
    yield f"  what does not come again: {np.sqrt(rest):.1f} mm"


def rings(errors: Array, sent: Array) -> Iterator[str]:
    """Share of the errors in a band that follows the turns of each motor, by the mean behind them."""
    band = sosfiltfilt(butter(3, RINGS_HZ, "bandpass", fs=1.0 / PERIOD_S, output="sos"), errors, axis=0)
    after = round(AFTER_S / PERIOD_S)
    for motor in range(sent.shape[1]):
        speed = np.gradient(sent[:, motor])
        turns = np.flatnonzero(np.sign(speed[1:]) != np.sign(speed[:-1]))
        turns = turns[(turns > 0) & (turns < len(errors) - after)]
        sharp = np.gradient(speed)[turns]
        windows = np.stack([band[k : k + after] for k in turns])
        mean = np.einsum("n,ntd->td", sharp, windows) / (sharp**2).sum()
        share = (sharp**2).sum() * (mean**2).sum(axis=1) / (windows**2).sum(axis=(0, 2)).mean()
        yield (
            f"  motor {motor + 1}: {share.max():.2f} at {PERIOD_S * int(share.argmax()):.2f} s after "
            f"{len(turns)} turns; by chance {1.0 / len(turns):.2f}"
        )


def network() -> Iterator[str]:
    """Other commands by gated recurrent units, from commands alone."""
    try:
        import torch  # type: ignore[import-not-found, unused-ignore]
    except ModuleNotFoundError:
        yield "  PyTorch is not installed"
        return
    sent, tip = recording(0)
    fitted, first = int(FITTED * len(tip)), int(JUDGED * len(tip))
    x = (sent - sent[:fitted].mean(axis=0)) / sent[:fitted].std(axis=0)
    middle, spread = tip[:fitted].mean(axis=0), tip[:fitted].std()
    inputs = torch.tensor(x[::EVERY], dtype=torch.float32)
    outputs = torch.tensor(((tip - middle) / spread)[::EVERY], dtype=torch.float32)

    class Net(torch.nn.Module):  # type: ignore[misc, name-defined, unused-ignore]
        def __init__(self) -> None:
            super().__init__()
            self.past = torch.nn.GRU(x.shape[1], UNITS, batch_first=True)
            self.out = torch.nn.Linear(UNITS + x.shape[1], 3)

        def forward(self, of: Any) -> Any:
            states = torch.nn.functional.dropout(self.past(of)[0], 0.1, self.training)
            return self.out(torch.cat((states, of), 2))

    found = []
    for seed in range(SEEDS):
        torch.manual_seed(seed)
        draw, net = np.random.default_rng(seed), Net()
        search = torch.optim.AdamW(net.parameters(), 3e-3, weight_decay=0.1)
        slower = torch.optim.lr_scheduler.CosineAnnealingLR(search, STEPS)
        for _ in range(STEPS):
            begins = draw.integers(0, fitted // EVERY - ROWS, BATCH).tolist()
            of = torch.stack([inputs[k : k + ROWS] for k in begins])
            target = torch.stack([outputs[k : k + ROWS] for k in begins])
            off = net(of + NOISE * torch.randn_like(of)) - target
            search.zero_grad()
            (off[:, BEGIN:] ** 2).mean().backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            search.step()
            slower.step()
        net.eval()
        with torch.no_grad():
            found.append(net(inputs[None])[0].numpy())
    errors = 1e3 * (tip[::EVERY] - middle - spread * np.mean(found, axis=0))
    yield f"  {rms(errors[first // EVERY :]):.1f} mm on the part kept out"


def report() -> Iterator[str]:
    """All of it."""
    yield "gated recurrent units, commands alone, 0 g"
    yield from network()
    errors = {grams: left_over(grams) for grams in (0, 100)}
    for grams, each in errors.items():
        yield f"{grams} g, parts of the fitted rows by fits to the others: {rms(each):.2f} mm"
    yield "errors with 0 g, and what is alike with 100 g"
    yield from comes_again(errors[0], errors[100])
    yield f"{RINGS_HZ[0]} to {RINGS_HZ[1]} Hz: share of the mean of both that follows turns of the commands"
    sent, _ = recording(0)
    yield from rings((errors[0] + errors[100]) / 2.0, sent[: len(errors[0])])


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
