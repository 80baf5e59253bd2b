"""The corrected simulator: a robot in MuJoCo with the effects that a diagnosis identified.
Read first: `twin`, then `added_compliance` (springs) and `replay` (what its sensor reads).
Free: the inside of each file (how balance is found); tests/twin compares MuJoCo with the closed
form of every effect.
Others rely on: fields of twin.json and effects.json and the exported MJCF: users' files must stay
readable, so change docs/contracts.md with them and keep reading older files.
Never: weigh evidence or state a verdict; a twin simulates what was decided."""
