"""HTML pages about a recording, a fit or a diagnosis, and the page of the effects.
Free: figures, and wording of files (then run `scripts/messages`); tests/reports speak.
Others rely on: `Answer`, whose words terminal (cli) and viewer print too: run tests/cli as well;
`robot_scene.blame` (viewer); keys of a page's context: change the template pages/NAME.html.j2 too.
Never: judge; this room words and draws what an answer holds.
Read first: `answer` (the words of a diagnosis) and `wrench_answer`, `diagnosis_page`, `figures`."""
