"""The exit statuses of commands, and what they mean."""

DONE, NO, MISTAKE, INTERRUPTED = 0, 1, 2, 130

#: Shown in docs/scripts.md.
STATUSES = {
    DONE: "done, or the reader of a pipe (`head`) has enough",
    NO: "done, and the answer is no: pairs or trials failed, a store or row differs, a test is not "
    "covered by its training, a search found nothing, or you said no",
    MISTAKE: "not done, or only in part: a mistake in what was asked, or something missing; "
    "standard error says what, where, and what to do",
    INTERRUPTED: "stopped by Ctrl-C or SIGTERM; standard error says how to go on, if one can",
}
