#!/usr/bin/env python3
"""where.py PREFIX: the folder below PREFIX in which the running Python finds packages, relative to PREFIX."""
import os
import sys
import sysconfig

prefix = sys.argv[1]
for path in sys.path:  # what the interpreter does look at, nearest first
    if path.startswith(os.path.join(prefix, "lib") + os.sep) and path.endswith("-packages"):
        print(os.path.relpath(path, prefix))
        break
else:
    scheme = "deb_system" if "deb_system" in sysconfig.get_scheme_names() else sysconfig.get_default_scheme()
    print(os.path.relpath(sysconfig.get_path("purelib", scheme, {"base": prefix}), prefix))
