"""Print the tables of the documentation, measured on this machine.

python tests/benchmarks NAME [NAME ...] [--OPTION VALUE ...] [--csv | --latex]
python tests/benchmarks NAME --help     what a table measures, and its options
"""

import argparse
import inspect
import sys
from importlib import import_module
from pathlib import Path

from icpmodel.present.table import Table
from icpmodel.study.timing import machine

HERE = Path(__file__).parent
NAMES = sorted(path.stem for path in HERE.glob("*.py") if path.stem.isalpha() and path.stem != "harness")


def measured(name, **options):
    """The table of the module `name`, and the lines below it.

    The module has a generator `table`, of which the first item are the heads and the others the rows. After Ctrl-C
    the rows so far are there.
    """
    module = import_module(f"benchmarks.{name}")
    rows = module.table(**options)
    heads = next(rows)
    printed = []
    try:
        for row in rows:
            printed.append(row)
            if sys.stderr.isatty():
                print(*row[:3], file=sys.stderr)
    except KeyboardInterrupt:
        print("interrupted: the rows so far", file=sys.stderr)
    title = module.__doc__.partition("\n")[0].rstrip(".")
    table = Table(f"{title} ({machine()})", heads, tuple(printed))
    return table, module.below(table) if hasattr(module, "below") else []


def parser_of(name):
    """An option for each parameter of `table`, with its default."""
    function = import_module(f"benchmarks.{name}").table
    parser = argparse.ArgumentParser(
        prog=f"python tests/benchmarks {name}",
        description=inspect.getdoc(function),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for option, parameter in inspect.signature(function).parameters.items():
        default = parameter.default
        many = isinstance(default, tuple)
        kind = type((default or ("",))[0] if many else default)
        parser.add_argument(
            f"--{option.replace('_', '-')}",
            type=(lambda text: int(float(text))) if kind is int else kind,  # also 1e6
            nargs="*" if many else None,
            default=default,
            help=f"default: {default}",
        )
    forms = parser.add_mutually_exclusive_group()
    for form in ("csv", "latex"):
        forms.add_argument(f"--{form}", action="store_const", dest="form", const=form, default="text")
    return parser


def main(arguments):
    """Measure and print each table that the arguments name."""
    first = next((k for k, one in enumerate(arguments) if one.startswith("-")), len(arguments))
    names = arguments[:first]
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="+", choices=NAMES, metavar="NAME", help=", ".join(NAMES))
    parser.parse_args(names or arguments)
    for name in names:
        options = vars(parser_of(name).parse_args(arguments[first:]))
        form = options.pop("form")
        table, lines = measured(name, **options)
        made = {"csv": table.to_csv, "latex": table.to_latex, "text": table.__str__}
        print(made[form](), end="\n" if form == "text" else "")
        for line in lines if form == "text" else []:
            print(line)


if __name__ == "__main__":
    sys.path[0] = str(HERE.parent)
    main(sys.argv[1:])
