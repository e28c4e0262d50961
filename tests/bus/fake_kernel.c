/* The two system calls of the bus, preloaded: a test decides what the kernel hands over, and sees what it is given. */
#define _GNU_SOURCE
#include <errno.h>
#include <string.h>
#include <sys/socket.h>

enum { MOST = 64, ROOM = 72, CONTROL = 64 };

struct datagram {
    unsigned char bytes[ROOM], control[CONTROL];
    unsigned size, control_size;
};

/* Set and read by the test. */
struct datagram fake_received[MOST], fake_sent[MOST];
int fake_count, fake_errno, fake_flags, fake_accepted;

static unsigned least(size_t a, size_t b)
{
    return (unsigned)(a < b ? a : b);
}

int recvmmsg(int descriptor, struct mmsghdr *headers, unsigned count, int flags, struct timespec *timeout)
{
    (void)descriptor, (void)timeout;
    fake_flags = flags;
    if (fake_errno) {
        errno = fake_errno;
        return -1;
    }
    unsigned received = least(count, (size_t)fake_count);
    for (unsigned i = 0; i < received; i++) {
        struct msghdr *header = &headers[i].msg_hdr;
        headers[i].msg_len = least(fake_received[i].size, header->msg_iov[0].iov_len);
        memcpy(header->msg_iov[0].iov_base, fake_received[i].bytes, headers[i].msg_len);
        header->msg_controllen = least(fake_received[i].control_size, header->msg_controllen);
        memcpy(header->msg_control, fake_received[i].control, header->msg_controllen);
        header->msg_flags = 0x7F;
    }
    return (int)received;
}

int sendmmsg(int descriptor, struct mmsghdr *headers, unsigned count, int flags)
{
    (void)descriptor;
    fake_flags = flags;
    if (fake_errno) {
        errno = fake_errno;
        return -1;
    }
    fake_count = (int)count;
    for (unsigned i = 0; i < count; i++) {
        fake_sent[i].size = least(headers[i].msg_hdr.msg_iov[0].iov_len, ROOM);
        memcpy(fake_sent[i].bytes, headers[i].msg_hdr.msg_iov[0].iov_base, fake_sent[i].size);
    }
    return fake_accepted;
}
