"""Switch MuJoCo's own log off for the process: errors that matter reach the user as one line of ours."""

import mujoco

# An unstable simulation is a failed episode, and an option that two models disagree on is settled here: neither is a reason to
# leave MUJOCO_LOG.TXT in the user's folder.
_log = mujoco.MjLogConfig.get()
_log.logto_console = _log.logto_file = False
_log.set()
