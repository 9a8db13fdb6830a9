import sys

from dtwin.cli import main

sys.exit(main())
