"""Choice of poses and motions: optimal designs, and checks that a path touches nothing.
Read first: `choose`; then `accuracy_plan` for few measurements that reach an accuracy.
Free: how each file searches; tests/planning judges criteria, exchanges and free paths.
Others rely on: names of the indices: public (docs/contracts.md); the poses that a seed chooses:
after a change of search, stopping rules or constants run `scripts/studies` (writes docs/studies).
Never: read a recording; a plan rests on the nominal robot and stated tolerances."""
