"""Which files lie on a drive that other machines can mount as well.

There SQLite's locks do not hold, and its log beside the file needs memory that processes share.
"""

from pathlib import Path

NETWORK_FILE_SYSTEMS = frozenset(
    (
        "nfs", "nfs4", "cifs", "smb3", "smbfs", "ncpfs", "afs", "ceph", "glusterfs", "lustre",
        "gpfs", "beegfs", "pvfs2", "orangefs", "davfs", "moosefs", "fuse.sshfs", "fuse.glusterfs",
        "fuse.ceph", "fuse.davfs", "fuse.mfs", "fuse.s3fs", "fuse.rclone", "fuse.juicefs",
    )
)  # fmt: skip
MOUNTS = Path("/proc/self/mounts")


def network_drive(file: Path, mounts: str | None = None) -> str:
    """The kind of the network drive on which a file lies, or would lie; empty if it is none, or if
    the system does not tell.

    `mounts` has one line for each mount, as `/proc/self/mounts`.
    """
    if mounts is None:
        try:
            mounts = MOUNTS.read_text("utf-8", "replace")
        except OSError:
            return ""
    place = file.expanduser().resolve()
    kinds = dict[Path, str]()
    for line in mounts.splitlines():
        fields = line.split(" ")
        if len(fields) > 2:
            kinds[Path(_unescaped(fields[1]))] = fields[2]  # of two at one place, the last is seen
    kind = next((kinds[folder] for folder in (place, *place.parents) if folder in kinds), "")
    return kind if kind in NETWORK_FILE_SYSTEMS else ""


def _unescaped(text: str) -> str:
    for code, character in (("\\040", " "), ("\\011", "\t"), ("\\012", "\n"), ("\\134", "\\")):
        text = text.replace(code, character)
    return text
