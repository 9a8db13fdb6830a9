"""How the processes of services are made: forked from one that has loaded their modules, or anew."""
