"""``python -m nurbs_ooc.cli``: the command without its installed script."""

from nurbs_ooc.cli.main import main

main(prog_name="nurbs-ooc")
