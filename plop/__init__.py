"""plop: recordings of a robot cutting a soft object in; a learned, scored dynamics model out."""

from plop.waiting import wait_briefly

wait_briefly()
