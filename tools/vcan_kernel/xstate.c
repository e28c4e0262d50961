/*
 * Preloaded into the user-mode kernel on CPUs with AMX.
 *
 * User-mode Linux before 6.13 keeps 2696 bytes of floating point state for each of its threads, all there was
 * when it was written. Where the CPU has AMX, the host's state is four times as long, and the host refuses a
 * shorter one with EFAULT, which kills the first process. What is missing is tile data. No process in there can
 * own any: the permission is asked for by arch_prctl, which the user-mode kernel does not pass on. So it is zeros.
 *
 * No headers: a bare compiler is enough to build it.
 */

struct span {
    void *base;
    unsigned long size;
};

enum { SYS_PTRACE = 101, PEEK_FIRST = 1, PEEK_LAST = 3, SETREGSET = 0x4205, X86_XSTATE = 0x202, AREA = 65536 };

extern long syscall(long number, ...);
extern int *__errno_location(void);

static void *widened(const struct span *narrow)
{
    static unsigned char area[AREA] __attribute__((aligned(64)));
    static struct span wide = {area, AREA}; /* the host takes as much of it as it has */
    const unsigned char *from = narrow->base;

    for (unsigned long i = 0; i < narrow->size && i < AREA; i++)
        area[i] = from[i];
    return &wide;
}

long ptrace(long request, long pid, void *addr, void *data)
{
    long word;

    if (request == SETREGSET && addr == (void *)X86_XSTATE)
        data = widened(data);
    if (request < PEEK_FIRST || request > PEEK_LAST)
        return syscall(SYS_PTRACE, request, pid, addr, data);
    /* The C library's contract for the three that peek: the word is the answer. */
    if (syscall(SYS_PTRACE, request, pid, addr, &word) < 0)
        return -1;
    *__errno_location() = 0;
    return word;
}
