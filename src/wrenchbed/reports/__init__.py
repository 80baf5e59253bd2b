"""HTML pages about a recording, a fit or a diagnosis, and the page of the effects.
Free: the inside of each file (figures; wording, then `scripts/messages`); tests/reports speak.
Others rely on: `Answer`, whose words terminal (cli) and viewer print too; `robot_scene`, whose
`blame` the viewer uses. Keys of a page's context are names in its template (pages/NAME.html.j2).
Never: judge; this room words and draws what an answer holds.
Read first: `answer` (the words of a diagnosis) and `wrench_answer`, `diagnosis_page`, `figures`."""
