/* Frames from and to a CAN socket in C: what bus/frame_io.py does in Python, which decides what is right.
 *
 * Optional: hatch_build.py compiles this file and _wire_*.c where there is a compiler, and wire.py chooses at start.
 *
 * It uses Python's limited API. One binary then serves every CPython from 3.11 on and survives an update of Python;
 * the functions that take the place of macros cost some nanoseconds a frame.
 */
#define _GNU_SOURCE
#include "_wire.h"

#include <errno.h>
#include <limits.h>
#include <stdalign.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>

/* From <linux/can.h>, <linux/socket.h> and <asm-generic/socket.h>, as in bus/receive.py and bus/raw_socket.py. */
enum { CAN_MTU = 16, CANFD_MTU = 72, DATA_AT = 8, MAX_DATA = 64, MAX_CLASSICAL_DATA = 8 };
enum { BATCH = 64, MOST_AT_ONCE = 8, CONTROL_BYTES = 64 };
enum { SO_TIMESTAMPNS_ = 35, SO_RXQ_OVFL_ = 40, CANFD_BRS_ = 1 };
#define EFF_FLAG 0x80000000u
#define RTR_FLAG 0x40000000u
#define ERR_FLAG 0x20000000u
#define EFF_MASK 0x1FFFFFFFu
#define SFF_MASK 0x7FFu
#define NS_PER_S 1000000000LL

typedef struct {
    long seconds, nanoseconds;
} Timespec;

/* Returns a new instance of a subclass of tuple; takes the reference to `fields`. Only the type's own tp_new knows how
 * to lay out the instance in every version of Python. */
PyObject *new_tuple_of(PyTypeObject *type, PyObject *fields)
{
    newfunc make = (newfunc)PyType_GetSlot(&PyTuple_Type, Py_tp_new);
    PyObject *arguments = fields == NULL ? NULL : PyTuple_Pack(1, fields);
    PyObject *made = arguments == NULL ? NULL : make(type, arguments, NULL);
    Py_XDECREF(arguments);
    Py_XDECREF(fields);
    return made;
}

PyTypeObject *require_tuple_type(PyObject *type)
{
    if (!PyType_Check(type) || !PyType_IsSubtype((PyTypeObject *)type, &PyTuple_Type)) {
        PyErr_SetString(PyExc_TypeError, "a subclass of tuple is needed");
        return NULL;
    }
    return (PyTypeObject *)type;
}

static PyObject *allocate(PyTypeObject *type)
{
    return ((allocfunc)PyType_GetSlot(type, Py_tp_alloc))(type, 0);
}

static void release(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(self);
    Py_DECREF(type);
}

/* ── FrameReceiver ── */

typedef struct {
    alignas(8) unsigned char frame[CANFD_MTU];
    alignas(8) unsigned char control[CONTROL_BYTES];
} Place;

typedef struct {
    PyObject_HEAD
    int descriptor;
    int used;  /* headers into which the kernel has written */
    int count; /* received frames that `take` has not returned yet */
    uint32_t dropped;
    PyTypeObject *frame_type;
    PyObject *bus;
    struct mmsghdr headers[BATCH];
    struct iovec vectors[BATCH];
    Place places[BATCH];
} Receiver;

static PyObject *receiver_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    int descriptor;
    PyObject *frame_type, *bus;
    if (keywords != NULL && PyDict_Size(keywords) > 0) {
        PyErr_SetString(PyExc_TypeError, "FrameReceiver takes no keywords");
        return NULL;
    }
    if (!PyArg_ParseTuple(arguments, "iOO!", &descriptor, &frame_type, &PyLong_Type, &bus) ||
        require_tuple_type(frame_type) == NULL)
        return NULL;
    Receiver *self = (Receiver *)allocate(type);
    if (self == NULL)
        return NULL;
    self->descriptor = descriptor;
    self->frame_type = (PyTypeObject *)Py_NewRef(frame_type);
    self->bus = Py_NewRef(bus);
    for (int i = 0; i < BATCH; i++) {
        self->vectors[i] = (struct iovec){self->places[i].frame, CANFD_MTU};
        self->headers[i].msg_hdr.msg_iov = &self->vectors[i];
        self->headers[i].msg_hdr.msg_iovlen = 1;
        self->headers[i].msg_hdr.msg_control = self->places[i].control;
        self->headers[i].msg_hdr.msg_controllen = CONTROL_BYTES;
    }
    return (PyObject *)self;
}

static void receiver_dealloc(PyObject *object)
{
    Receiver *self = (Receiver *)object;
    Py_XDECREF((PyObject *)self->frame_type);
    Py_XDECREF(self->bus);
    release(object);
}

static PyObject *receiver_receive(PyObject *object, PyObject *argument)
{
    Receiver *self = (Receiver *)object;
    int wait = PyObject_IsTrue(argument);
    if (wait < 0)
        return NULL;
    for (int i = 0; i < self->used; i++) {
        self->headers[i].msg_hdr.msg_controllen = CONTROL_BYTES;
        self->headers[i].msg_hdr.msg_flags = 0;
    }
    self->used = self->count = 0;
    int count;
    if (wait) {
        Py_BEGIN_ALLOW_THREADS
        count = recvmmsg(self->descriptor, self->headers, BATCH, MSG_WAITFORONE, NULL);
        Py_END_ALLOW_THREADS
    } else { /* returns at once: another thread that took the GIL now would keep it for milliseconds */
        count = recvmmsg(self->descriptor, self->headers, BATCH, MSG_DONTWAIT, NULL);
    }
    if (count < 0) {
        if (errno != EAGAIN && errno != EINTR)
            return PyErr_SetFromErrno(PyExc_OSError);
        count = 0;
    }
    self->used = self->count = count;
    return PyLong_FromLong(count);
}

/* Reads receive time (0: none) and drop counter (0: not told) of one frame. Ends at a message that is cut off. */
static void read_control(const struct msghdr *header, int64_t *wall_ns, uint32_t *dropped)
{
    const unsigned char *control = header->msg_control;
    size_t end = header->msg_controllen < CONTROL_BYTES ? header->msg_controllen : CONTROL_BYTES;
    size_t at = 0;
    *wall_ns = 0;
    *dropped = 0;
    while (at + sizeof(struct cmsghdr) <= end) {
        struct cmsghdr message;
        memcpy(&message, control + at, sizeof message);
        if (message.cmsg_len < sizeof message || message.cmsg_len > end - at)
            break;
        const unsigned char *content = control + at + sizeof message;
        size_t size = message.cmsg_len - sizeof message;
        if (message.cmsg_level == SOL_SOCKET && message.cmsg_type == SO_TIMESTAMPNS_ && size >= sizeof(Timespec)) {
            Timespec stamp;
            memcpy(&stamp, content, sizeof stamp);
            int64_t ns;
            if (__builtin_mul_overflow((int64_t)stamp.seconds, NS_PER_S, &ns) ||
                __builtin_add_overflow(ns, (int64_t)stamp.nanoseconds, &ns))
                ns = stamp.seconds < 0 ? INT64_MIN : INT64_MAX;
            *wall_ns = ns;
        } else if (message.cmsg_level == SOL_SOCKET && message.cmsg_type == SO_RXQ_OVFL_ && size >= sizeof *dropped) {
            memcpy(dropped, content, sizeof *dropped);
        }
        at += (message.cmsg_len + sizeof(size_t) - 1) & ~(sizeof(size_t) - 1);
    }
}

/* Never later than now: a wall clock set forwards between the stamp and our reading of it would make an old frame look
 * fresh. */
static int64_t stamp_of(int64_t wall_ns, int64_t offset_ns, int64_t now_ns)
{
    int64_t stamp_ns;
    if (wall_ns == 0)
        return now_ns;
    if (__builtin_add_overflow(wall_ns, offset_ns, &stamp_ns))
        stamp_ns = wall_ns < 0 ? INT64_MIN : INT64_MAX;
    return stamp_ns < now_ns ? stamp_ns : now_ns;
}

static PyObject *make_frame(const Receiver *self, int place, int64_t stamp_ns)
{
    const unsigned char *frame = self->places[place].frame;
    uint32_t word;
    memcpy(&word, frame, sizeof word);
    int length = frame[4] < MAX_DATA ? frame[4] : MAX_DATA;
    PyObject *values[FRAME_FIELDS] = {
        [CAN_ID] = PyLong_FromUnsignedLong(word & (word & EFF_FLAG ? EFF_MASK : SFF_MASK)),
        [DATA] = PyBytes_FromStringAndSize((const char *)frame + DATA_AT, length),
        [STAMP_NS] = PyLong_FromLongLong(stamp_ns),
        [IS_EXTENDED] = PyBool_FromLong((word & EFF_FLAG) != 0),
        [IS_REMOTE] = PyBool_FromLong((word & RTR_FLAG) != 0),
        [IS_FD] = PyBool_FromLong(self->headers[place].msg_len == CANFD_MTU),
        [IS_ERROR] = PyBool_FromLong((word & ERR_FLAG) != 0),
        [BUS] = Py_NewRef(self->bus),
    };
    PyObject *fields = PyTuple_New(FRAME_FIELDS);
    for (int i = 0; i < FRAME_FIELDS; i++) {
        if (fields != NULL && values[i] != NULL)
            PyTuple_SetItem(fields, i, values[i]); /* cannot fail: new, and the place is in it */
        else {
            Py_XDECREF(values[i]);
            Py_CLEAR(fields);
        }
    }
    return new_tuple_of(self->frame_type, fields);
}

static PyObject *receiver_take(PyObject *object, PyObject *const *arguments, Py_ssize_t count)
{
    Receiver *self = (Receiver *)object;
    if (count != 3 || !PyList_Check(arguments[0])) {
        PyErr_SetString(PyExc_TypeError, "take(inbox: list, offset_ns: int, now_ns: int)");
        return NULL;
    }
    int64_t offset_ns = PyLong_AsLongLong(arguments[1]);
    int64_t now_ns = PyLong_AsLongLong(arguments[2]);
    if (PyErr_Occurred())
        return NULL;
    unsigned long long lost = 0;
    int received = self->count;
    self->count = 0;
    for (int i = 0; i < received; i++) {
        int64_t wall_ns;
        uint32_t dropped;
        read_control(&self->headers[i].msg_hdr, &wall_ns, &dropped);
        if (dropped != 0) {
            lost += (uint32_t)(dropped - self->dropped);
            self->dropped = dropped;
        }
        PyObject *frame = make_frame(self, i, stamp_of(wall_ns, offset_ns, now_ns));
        if (frame == NULL)
            return NULL;
        int failed = PyList_Append(arguments[0], frame);
        Py_DECREF(frame);
        if (failed)
            return NULL;
    }
    return PyLong_FromUnsignedLongLong(lost);
}

static PyMethodDef receiver_methods[] = {
    {"receive", receiver_receive, METH_O, NULL},
    {"take", (PyCFunction)(void (*)(void))receiver_take, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot receiver_slots[] = {
    {Py_tp_new, receiver_new},
    {Py_tp_dealloc, receiver_dealloc},
    {Py_tp_methods, receiver_methods},
    {0, NULL},
};

static PyType_Spec receiver_spec = {
    .name = "vehicle_iface._wire.FrameReceiver",
    .basicsize = sizeof(Receiver),
    .flags = Py_TPFLAGS_DEFAULT,
    .slots = receiver_slots,
};

/* ── FrameSender ── */

typedef struct {
    PyObject_HEAD
    int descriptor;
    PyObject *pack; /* raw_socket.pack_frame, for every frame that is not plain */
    struct mmsghdr headers[MOST_AT_ONCE];
    struct iovec vectors[MOST_AT_ONCE];
    alignas(8) unsigned char places[MOST_AT_ONCE][CANFD_MTU];
} Sender;

static PyObject *sender_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    int descriptor;
    PyObject *pack;
    if (keywords != NULL && PyDict_Size(keywords) > 0) {
        PyErr_SetString(PyExc_TypeError, "FrameSender takes no keywords");
        return NULL;
    }
    if (!PyArg_ParseTuple(arguments, "iO", &descriptor, &pack))
        return NULL;
    Sender *self = (Sender *)allocate(type);
    if (self == NULL)
        return NULL;
    self->descriptor = descriptor;
    self->pack = Py_NewRef(pack);
    for (int i = 0; i < MOST_AT_ONCE; i++) {
        self->vectors[i].iov_base = self->places[i];
        self->headers[i].msg_hdr.msg_iov = &self->vectors[i];
        self->headers[i].msg_hdr.msg_iovlen = 1;
    }
    return (PyObject *)self;
}

static void sender_dealloc(PyObject *object)
{
    Py_XDECREF(((Sender *)object)->pack);
    release(object);
}

static int is_plain_bool(PyObject *value)
{
    return value == Py_True || value == Py_False;
}

/* Packs a plain frame, of bytes and booleans that fit; returns its size, or 0 if it is not plain, with no error set. */
static size_t pack_plain(PyObject *frame, unsigned char *place)
{
    if (!PyTuple_Check(frame) || PyTuple_Size(frame) != FRAME_FIELDS)
        return 0;
    PyObject *can_id = PyTuple_GetItem(frame, CAN_ID), *data = PyTuple_GetItem(frame, DATA);
    PyObject *is_extended = PyTuple_GetItem(frame, IS_EXTENDED), *is_remote = PyTuple_GetItem(frame, IS_REMOTE);
    PyObject *is_fd = PyTuple_GetItem(frame, IS_FD);
    if (!PyLong_CheckExact(can_id) || !PyBytes_CheckExact(data) || !is_plain_bool(is_extended) ||
        !is_plain_bool(is_remote) || !is_plain_bool(is_fd))
        return 0;
    unsigned long word = PyLong_AsUnsignedLong(can_id);
    if (word == (unsigned long)-1 && PyErr_Occurred()) {
        PyErr_Clear();
        return 0;
    }
    Py_ssize_t length = PyBytes_Size(data);
    if (word > EFF_MASK || length > (is_fd == Py_True ? MAX_DATA : MAX_CLASSICAL_DATA))
        return 0;
    uint32_t sent = (uint32_t)word;
    if (is_extended == Py_True)
        sent |= EFF_FLAG;
    if (is_remote == Py_True)
        sent |= RTR_FLAG;
    size_t size = is_fd == Py_True ? CANFD_MTU : CAN_MTU;
    memset(place, 0, size);
    memcpy(place, &sent, sizeof sent);
    place[4] = (unsigned char)length;
    place[5] = is_fd == Py_True ? CANFD_BRS_ : 0;
    memcpy(place + DATA_AT, PyBytes_AsString(data), (size_t)length);
    return size;
}

/* Packs a frame with the Python code; returns its size, or 0 with an error set. */
static size_t pack_in_python(PyObject *pack, PyObject *frame, unsigned char *place)
{
    PyObject *packed = PyObject_CallFunctionObjArgs(pack, frame, NULL);
    char *bytes;
    Py_ssize_t size;
    if (packed == NULL)
        return 0;
    if (PyBytes_AsStringAndSize(packed, &bytes, &size) < 0) {
        Py_DECREF(packed);
        return 0;
    }
    if (size < 1 || size > CANFD_MTU) {
        Py_DECREF(packed);
        PyErr_SetString(PyExc_ValueError, "a packed frame has 1 to 72 bytes");
        return 0;
    }
    memcpy(place, bytes, (size_t)size);
    Py_DECREF(packed);
    return (size_t)size;
}

static PyObject *sender_send(PyObject *object, PyObject *frames)
{
    Sender *self = (Sender *)object;
    if (!PyTuple_Check(frames) || PyTuple_Size(frames) > MOST_AT_ONCE) {
        PyErr_Format(PyExc_ValueError, "send: a tuple of at most %d frames is needed", MOST_AT_ONCE);
        return NULL;
    }
    int count = (int)PyTuple_Size(frames);
    for (int i = 0; i < count; i++) {
        PyObject *frame = PyTuple_GetItem(frames, i);
        size_t size = pack_plain(frame, self->places[i]);
        if (size == 0 && (size = pack_in_python(self->pack, frame, self->places[i])) == 0)
            return NULL;
        self->vectors[i].iov_len = size;
    }
    int sent = sendmmsg(self->descriptor, self->headers, (unsigned)count, MSG_DONTWAIT);
    if (sent < 0) {
        if (errno != ENOBUFS && errno != EAGAIN && errno != EINTR)
            return PyErr_SetFromErrno(PyExc_OSError);
        sent = 0;
    }
    return PyLong_FromLong(sent);
}

static PyMethodDef sender_methods[] = {
    {"send", sender_send, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot sender_slots[] = {
    {Py_tp_new, sender_new},
    {Py_tp_dealloc, sender_dealloc},
    {Py_tp_methods, sender_methods},
    {0, NULL},
};

static PyType_Spec sender_spec = {
    .name = "vehicle_iface._wire.FrameSender",
    .basicsize = sizeof(Sender),
    .flags = Py_TPFLAGS_DEFAULT,
    .slots = sender_slots,
};

/* ── module ── */

static int add_type(PyObject *module, PyType_Spec *spec)
{
    PyObject *type = PyType_FromModuleAndSpec(module, spec, NULL);
    int failed = type == NULL || PyModule_AddType(module, (PyTypeObject *)type) < 0;
    Py_XDECREF(type);
    return failed ? -1 : 0;
}

static int fill_module(PyObject *module)
{
    if (PyModule_AddStringConstant(module, "SOURCE_CRC32", SOURCE_CRC32) < 0)
        return -1;
    PyType_Spec *const specs[] = {&receiver_spec, &sender_spec, &packer_spec, &unpacker_spec};
    for (size_t i = 0; i < sizeof specs / sizeof *specs; i++)
        if (add_type(module, specs[i]) < 0)
            return -1;
    return 0;
}

static PyModuleDef_Slot module_slots[] = {
    {Py_mod_exec, fill_module},
    {0, NULL},
};

static PyModuleDef definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "vehicle_iface._wire",
    .m_slots = module_slots,
};

PyMODINIT_FUNC PyInit__wire(void)
{
    return PyModuleDef_Init(&definition);
}
