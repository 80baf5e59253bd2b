"""Choice of poses and motions: optimal designs, and checks that a path touches nothing.
Read first: `choose`; then `accuracy_plan` for few measurements that reach an accuracy.
Free: the inside of each file (search and stopping rules); tests/planning holds criteria and
certified bounds.
Others rely on: names of the indices (docs/contracts.md), the poses that a seed chooses
(`scripts/studies`).
Never: read a recording; a plan rests on the nominal robot and stated tolerances."""
