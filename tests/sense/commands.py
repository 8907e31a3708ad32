"""Commands of a user, and paths of pressures for them."""

import subprocess
import sys

SIM = """    sim:
      payload_g: {grams}
      payload_at_s: 3
      errors: {{modulus_percent: [4, -3], moment_percent: -2, regulator_bar: 0.03, hysteresis_bar: 0.03}}
"""


def contid(folder, *arguments, code=0):
    command = [sys.executable, "-m", "contid", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == code, done.stderr
    return done


def rests(path, poses, last_s=0.0):
    """A path that rests at pressures for 1 s each, at the last one longer."""
    axes = [f"s{i}.p{j}_bar" for i in (1, 2) for j in (1, 2, 3)]
    lines, t = [",".join(["t_s", *axes])], 0.0
    for number, bar in enumerate(poses):
        end = t + 1.0 + (last_s if number == len(poses) - 1 else 0.0)
        for at in (t, t + 1e-3, end - 1e-3, end):
            lines.append(f"{at:.3f}," + ",".join(f"{value:.4f}" for value in bar))
        t = end + 1.2
    path.write_text("\n".join(lines) + "\n")
