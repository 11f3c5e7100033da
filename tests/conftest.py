"""What every test may rely on: programs that it starts hear Ctrl-C, even when the shell that runs the tests in the background does not."""

import signal

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
