/* A wrong clock, for a program that is started with this in LD_PRELOAD: the machine's clock is shown ahead by as many seconds as the file
 * ZK0_CLOCK_AHEAD holds. Clocks that nobody can set are shown as they are. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *shown) {
    const char *file = getenv("ZK0_CLOCK_AHEAD");
    long failed = syscall(SYS_clock_gettime, clock, shown), ahead = 0;
    if (failed || clock != CLOCK_REALTIME || !file) return (int)failed;
    FILE *held = fopen(file, "r");
    if (!held) return 0;
    if (fscanf(held, "%ld", &ahead) == 1) shown->tv_sec += ahead;
    fclose(held);
    return 0;
}
