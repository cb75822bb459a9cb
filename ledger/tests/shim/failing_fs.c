/* A file system that fails, for a program that is started with this in LD_PRELOAD.
 *
 * Calls that change what is below the folder ZK0_FAULT_IN are counted from 1. At the call numbered ZK0_FAULT_AT happens what
 * ZK0_FAULT says:
 *
 *   error=N   it fails with errno N, once;
 *   broken=N  it fails with errno N, and so do all after it;
 *   torn      half of what it would write is written, and the process is killed (a call that writes nothing: killed before it);
 *   short     this and all later writes take half of what they are given, as write(2) may, and say so.
 *
 * With ZK0_FAULT_OF=reads, the calls that read a file there are counted and fail instead.
 *
 * At its end the process writes the number of calls to the file ZK0_FAULT_COUNT, if that is given. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static atomic_long calls;

static int below(const char *path) {
    const char *folder = getenv("ZK0_FAULT_IN");
    return folder && path && strncmp(path, folder, strlen(folder)) == 0;
}

static int below_at(int dir, const char *path) {
    char name[64], folder[PATH_MAX];
    if (!path || path[0] == '/' || dir == AT_FDCWD) return below(path);
    snprintf(name, sizeof name, "/proc/self/fd/%d", dir);
    ssize_t length = readlink(name, folder, sizeof folder - 1);
    if (length < 0) return 0;
    folder[length] = 0;
    return below(folder);
}

static int is_ours(int file) { return below_at(file, ""); }

/* Whether calls of this kind are counted. */
static int counted(int reads) {
    const char *of = getenv("ZK0_FAULT_OF");
    return reads == (of && !strcmp(of, "reads"));
}

enum what { GOES, FAILS, SHORT };

/* What happens at this call; does not return when the process is to be killed before it. `torn` is set when half of a write
 * comes first. */
static enum what fate(int *torn) {
    const char *fault = getenv("ZK0_FAULT"), *at = getenv("ZK0_FAULT_AT");
    long number = atomic_fetch_add(&calls, 1) + 1, chosen = at ? atol(at) : 0;
    if (!fault || !chosen || number < chosen) return GOES;
    if (!strcmp(fault, "short")) return SHORT;
    if (!strcmp(fault, "torn")) {
        if (torn) *torn = 1;
        else kill(getpid(), SIGKILL);
        return SHORT;
    }
    if (!strncmp(fault, "error=", 6) && number > chosen) return GOES;
    errno = atoi(strchr(fault, '=') + 1);
    return FAILS;
}

__attribute__((destructor)) static void count(void) {
    const char *path = getenv("ZK0_FAULT_COUNT");
    FILE *file = path ? fopen(path, "w") : NULL;
    if (!file) return;
    fprintf(file, "%ld\n", atomic_load(&calls));
    fclose(file);
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

/* A call that writes nothing itself. */
#define CALL(type, name, parameters, arguments, ours)                \
    type name parameters {                                            \
        if (counted(0) && (ours) && fate(NULL) == FAILS) return -1;   \
        return REAL(name) arguments;                                  \
    }

/* A call that writes `size` bytes. */
#define WRITE(name, parameters, arguments, half)                      \
    ssize_t name parameters {                                         \
        int torn = 0;                                                 \
        if (!counted(0) || !is_ours(file)) return REAL(name) arguments; \
        switch (fate(&torn)) {                                        \
        case FAILS: return -1;                                        \
        case GOES: return REAL(name) arguments;                       \
        default: break;                                               \
        }                                                             \
        ssize_t written = REAL(name) half;                            \
        if (torn) kill(getpid(), SIGKILL);                            \
        return written;                                               \
    }

#define HALF ((size + 1) / 2)

WRITE(write, (int file, const void *bytes, size_t size), (file, bytes, size), (file, bytes, HALF))
WRITE(pwrite, (int file, const void *bytes, size_t size, off_t at), (file, bytes, size, at), (file, bytes, HALF, at))
WRITE(pwrite64, (int file, const void *bytes, size_t size, off64_t at), (file, bytes, size, at), (file, bytes, HALF, at))

CALL(int, fsync, (int file), (file), is_ours(file))
CALL(int, fdatasync, (int file), (file), is_ours(file))
CALL(int, sync_file_range, (int file, off64_t at, off64_t size, unsigned how), (file, at, size, how), is_ours(file))
CALL(int, ftruncate, (int file, off_t size), (file, size), is_ours(file))
CALL(int, ftruncate64, (int file, off64_t size), (file, size), is_ours(file))
CALL(int, fallocate, (int file, int how, off_t at, off_t size), (file, how, at, size), is_ours(file))
CALL(int, fallocate64, (int file, int how, off64_t at, off64_t size), (file, how, at, size), is_ours(file))
CALL(int, rename, (const char *from, const char *to), (from, to), below(to))
CALL(int, renameat, (int from, const char *old, int to, const char *new), (from, old, to, new), below_at(to, new))
CALL(int, link, (const char *from, const char *to), (from, to), below(to))
CALL(int, linkat, (int from, const char *old, int to, const char *new, int how), (from, old, to, new, how), below_at(to, new))
CALL(int, unlink, (const char *path), (path), below(path))
CALL(int, unlinkat, (int dir, const char *path, int how), (dir, path, how), below_at(dir, path))
CALL(int, mkdir, (const char *path, mode_t mode), (path, mode), below(path))
CALL(int, mkdirat, (int dir, const char *path, mode_t mode), (dir, path, mode), below_at(dir, path))

/* Opening changes something when it makes a file, or empties one. */
#define OPEN(name, parameters, arguments, place)                      \
    int name parameters {                                             \
        mode_t mode = 0;                                              \
        if (how & (O_CREAT | O_TMPFILE)) {                            \
            va_list more;                                             \
            va_start(more, how);                                      \
            mode = va_arg(more, mode_t);                              \
            va_end(more);                                             \
        }                                                             \
        if ((how & (O_CREAT | O_TRUNC)) && counted(0) && (place) && fate(NULL) == FAILS) return -1; \
        return REAL(name) arguments;                                  \
    }

OPEN(open, (const char *path, int how, ...), (path, how, mode), below(path))
OPEN(open64, (const char *path, int how, ...), (path, how, mode), below(path))
OPEN(openat, (int dir, const char *path, int how, ...), (dir, path, how, mode), below_at(dir, path))
OPEN(openat64, (int dir, const char *path, int how, ...), (dir, path, how, mode), below_at(dir, path))

#define READ(name, parameters, arguments)                             \
    ssize_t name parameters {                                         \
        if (counted(1) && is_ours(file) && fate(NULL) == FAILS) return -1; \
        return REAL(name) arguments;                                  \
    }

READ(read, (int file, void *bytes, size_t size), (file, bytes, size))
READ(pread, (int file, void *bytes, size_t size, off_t at), (file, bytes, size, at))
READ(pread64, (int file, void *bytes, size_t size, off64_t at), (file, bytes, size, at))
