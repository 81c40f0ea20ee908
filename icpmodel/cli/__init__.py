"""The command line: arguments in, text or JSON out. No numerics here.

Exit codes: 0 success (solved; for `crosscheck` also confirmed); 1 not solved or not confirmed; 2
wrong input, or a file that cannot be read or written; 130 interrupted. After an interrupt `solve`
and `crosscheck` print the results so far, and exit with 0 or 1 as above.
"""

from __future__ import annotations

import io
import os
import shlex
import signal
import sys
import threading
from contextlib import suppress
from importlib import import_module
from types import FrameType
from typing import Any

import click

from ..errors import FileError, IcpError, InputError, did_you_mean
from ..numerics.plugins import load_plugins
from ..numerics.rounding import CTRL_C, is_ctrl_c
from ..numerics.threads import ABANDONED_THREAD
from .output import STANDARD_INPUT, compilation_announced, complain, keep_standard_output

__all__ = ["main"]

#: the option with which Pyomo calls solvers of .nl files: it takes every solver that it does not know for one
_ASL = "-AMPL"
_NO_ASL = (
    'this command reads no .nl files. In Pyomo, `import icpmodel.modelling.pyomo` before SolverFactory("icpmodel"), '
    "or take icpmodel.pyomo_solver(), and build the model again: this call has rewritten its Complementarity"
)

#: the environment variables in which launchers of MPI give each process its rank
_RANK_VARIABLES = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID")
#: command → its module, which is imported when the command is requested; ordered by use
_COMMAND_MODULES = {
    "scenes": "solving",
    "solve": "solving",
    "crosscheck": "solving",
    "explain": "solving",
    "race": "charting",
    "stability": "charting",
    "report": "charting",
    "distributed": "distributing",
}

_EXAMPLES = {
    "scenes": "list the built-in scenes",
    "solve membrane --n 10000": "solve a scene",
    "solve p.npz -o answer.npz": "solve a problem from a file",
    "solve --A A.npy --q q.csv": "solve a problem from files of A and q",
    "crosscheck membrane": "solve, then have osqp, cvxpy and Pyomo check the answer",
    "explain membrane": "what is proved before a solve",
    "race membrane -o race.png": "time against error, with independent solvers",
    "stability units -o map.png": "where a method converges, how fast, and where it fails",
    "report membrane -o page.html": "the results of all these, with pictures, on one page",
    "distributed membrane --n 1e6": "on the ranks of mpiexec, with petsc4py",
}


class _NoReaderError(Exception):
    """Standard output is a pipe without a reader."""


class _Commands(click.Group):
    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:  # click would end the process with code 1
            raise _NoReaderError(error.strerror) from None
        except (FileError, InputError) as error:
            if STANDARD_INPUT not in ctx.meta:
                raise
            raise type(error)(str(error).replace(ctx.meta[STANDARD_INPUT], STANDARD_INPUT)) from error

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Examples"):
            examples = [(f"icpmodel {typed}", description) for typed, description in _EXAMPLES.items()]
            formatter.write_dl(examples, col_max=40)
        super().format_epilog(ctx, formatter)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMAND_MODULES)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List each command with the first sentence of its docstring, not shortened."""
        commands = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        with formatter.section("Commands"):
            formatter.write_dl([(name, one.get_short_help_str(limit=500)) for name, one in commands.items() if one])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in _COMMAND_MODULES:
            command: click.Command = getattr(import_module(f".{_COMMAND_MODULES[cmd_name]}", __package__), cmd_name)
            return command
        if not (ctx.resilient_parsing or cmd_name.startswith("-")):
            hint = did_you_mean(cmd_name, _COMMAND_MODULES) or f"; one of {', '.join(_COMMAND_MODULES)} was expected"
            raise click.UsageError(f"there is no command {cmd_name!r}{hint}")
        return None


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog='Completion of names in bash: eval "$(_ICPMODEL_COMPLETE=bash_source icpmodel)"; in other shells '
    "zsh_source or fish_source.",
)
@click.version_option(package_name="icpmodel")
def commands() -> None:
    """Implicit complementarity problems: find z with p = Az + q >= 0, r = z - psi(z) >= 0 and p'r = 0."""


def main(arguments: list[str] | None = None) -> None:
    """The entry point: every error is printed as one line on standard error.

    Parameters
    ----------
    arguments : list of str, optional
        Arguments of the command, by default those of this process. In that case the process does not
        wait at its end for a step that has exceeded its time limit.

    Raises
    ------
    SystemExit
        With the exit code.

    Examples
    --------
    >>> try:
    ...     main(["--version"])
    ... except SystemExit as end:
    ...     print(end.code)
    icpmodel, version ...
    0
    """
    if arguments is not None:
        sys.exit(_run(arguments))
    if any(name in os.environ for name in _RANK_VARIABLES):
        signal.signal(signal.SIGTERM, _leave)
    keep_standard_output()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # escape characters outside its encoding
            stream.reconfigure(errors="backslashreplace")
    code = _run(sys.argv[1:])
    if any(thread.name == ABANDONED_THREAD for thread in threading.enumerate()):
        with suppress(OSError):
            for stream in filter(None, (sys.stdout, sys.stderr)):
                stream.flush()
        os._exit(code)
    sys.exit(code)


def _leave(signum: int, frame: FrameType | None) -> None:
    """End this process at SIGTERM, which mpiexec sends to all ranks after Ctrl-C; rank 0 reports it."""
    if all(os.environ.get(name, "0") == "0" for name in _RANK_VARIABLES):
        os.write(2, b"icpmodel: interrupted\n")
    os._exit(130)


def _run(arguments: list[str]) -> int:
    """Run the command, print its error if there is one, and return the exit code."""
    code: Any
    try:
        # a single line, in which file names that are not UTF-8 are escaped
        typed = shlex.join(["icpmodel", *arguments]).replace("\n", "\\n").encode("utf-8", "backslashreplace").decode()
        if _ASL in arguments:
            raise click.UsageError(_NO_ASL)
        load_plugins()
        with compilation_announced():
            code = commands.main(args=arguments, prog_name="icpmodel", standalone_mode=False, obj=typed)
        if sys.stdout is not None:  # None if the shell has closed it
            sys.stdout.flush()
    except click.exceptions.Exit as stop:
        code = stop.exit_code
    except click.exceptions.NoArgsIsHelpError as help_page:
        help_page.show()
        code = 2
    except click.ClickException as error:
        code = complain(error.format_message())
    except IcpError as error:
        code = complain(str(error))
    except MemoryError as error:
        code = complain(f"not enough memory: {error}")
    except (KeyboardInterrupt, click.Abort, *CTRL_C) as error:
        if isinstance(error, CTRL_C) and not is_ctrl_c(error):
            raise
        code = complain("interrupted", 130)
    except (OSError, _NoReaderError) as error:  # a full disk, or a reader such as head that has ended
        code = complain(f"cannot write the output: {getattr(error, 'strerror', None) or error}")
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  else Python prints an error again at exit
    return code or 0
