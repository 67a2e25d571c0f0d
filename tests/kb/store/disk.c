/* Preloaded by tests: notes what is written to files of a folder and what is synced, or pretends that the disk is full. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static long written;

static int watched(int fd, char *path) {
    char link[64];
    const char *folder = getenv("DISK_FOLDER");
    if (!folder) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, 500);
    if (length < 0) return 0;
    path[length] = 0;
    return strncmp(path, folder, strlen(folder)) == 0;
}

static ssize_t raw_write(int fd, const void *data, size_t count) {
    ssize_t (*real)(int, const void *, size_t) = dlsym(RTLD_NEXT, "write");
    return real(fd, data, count);
}

static void note(char kind, const char *path, int64_t at, const void *data, uint64_t count) {
    static int log = -1;
    const char *name = getenv("DISK_LOG");
    if (!name) return;
    if (log < 0) log = open(name, O_WRONLY | O_CREAT | O_APPEND, 0600);
    uint64_t head[3] = {strlen(path), (uint64_t)at, count};
    raw_write(log, &kind, 1);
    raw_write(log, head, sizeof head);
    raw_write(log, path, head[0]);
    if (data) raw_write(log, data, count);
}

static int is_full(size_t count) {
    const char *room = getenv("DISK_ROOM");
    if (!room) return 0;
    written += count;
    return written > atol(room);
}

static ssize_t put(const char *name, int fd, const void *data, size_t count, off_t at) {
    char path[512];
    ssize_t (*real)(int, const void *, size_t, off_t) = dlsym(RTLD_NEXT, name);
    int mine = watched(fd, path);
    if (mine && is_full(count)) {
        errno = ENOSPC;
        return -1;
    }
    if (mine) note('w', path, at, data, count);
    return real(fd, data, count, at);
}

ssize_t pwrite64(int fd, const void *data, size_t count, off_t at) { return put("pwrite64", fd, data, count, at); }
ssize_t pwrite(int fd, const void *data, size_t count, off_t at) { return put("pwrite", fd, data, count, at); }

ssize_t write(int fd, const void *data, size_t count) {
    char path[512];
    if (watched(fd, path)) {
        if (is_full(count)) {
            errno = ENOSPC;
            return -1;
        }
        note('w', path, lseek(fd, 0, SEEK_CUR), data, count);
    }
    return raw_write(fd, data, count);
}

static int sync_as(const char *name, int fd) {
    char path[512];
    int (*real)(int) = dlsym(RTLD_NEXT, name);
    if (watched(fd, path)) note('s', path, 0, 0, 0);
    return real(fd);
}

int fsync(int fd) { return sync_as("fsync", fd); }
int fdatasync(int fd) { return sync_as("fdatasync", fd); }

static int cut(const char *name, int fd, off_t size) {
    char path[512];
    int (*real)(int, off_t) = dlsym(RTLD_NEXT, name);
    if (watched(fd, path)) note('t', path, size, 0, 0);
    return real(fd, size);
}

int ftruncate(int fd, off_t size) { return cut("ftruncate", fd, size); }
int ftruncate64(int fd, off_t size) { return cut("ftruncate64", fd, size); }
