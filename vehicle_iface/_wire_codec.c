/* Payloads from values in C: what codec/encoder.py does in Python for a message without multiplexer, whose signals have
 * at most 53 bits. codec/c_codec.py describes the message. The answer is None for every value that is not plainly right:
 * the Python code then decides.
 */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "_wire.h"

enum { MAX_LENGTH = 64 };

/* A double holds every integer up to here. */
#define EXACT 9007199254740992.0

/* ── bits ── */

/* Bits are counted from the least significant one of the payload, read as one integer of this byte order. */
typedef struct {
    int shift, width, is_big;
} Bits;

static bool bits_fit(const Bits *bits, int length)
{
    return bits->shift >= 0 && bits->width >= 1 && bits->width <= 64 && bits->shift <= 8 * length - bits->width;
}

static uint64_t mask_of(int width)
{
    return width >= 64 ? UINT64_MAX : ((uint64_t)1 << width) - 1;
}

static void write_bits(unsigned char *data, int length, const Bits *bits, uint64_t number)
{
    int at = bits->shift / 8, offset = bits->shift % 8;
    for (int left = bits->width; left > 0; at++) {
        int count = 8 - offset < left ? 8 - offset : left;
        unsigned mask = ((1u << count) - 1) << offset;
        unsigned char *byte = data + (bits->is_big ? length - 1 - at : at);
        *byte = (unsigned char)((*byte & ~mask) | ((unsigned)(number << offset) & mask));
        number >>= count;
        left -= count;
        offset = 0;
    }
}

static uint64_t read_bits(const unsigned char *data, int length, const Bits *bits)
{
    uint64_t number = 0;
    int at = bits->shift / 8, offset = bits->shift % 8;
    for (int done = 0; done < bits->width; at++) {
        int count = 8 - offset < bits->width - done ? 8 - offset : bits->width - done;
        unsigned byte = data[bits->is_big ? length - 1 - at : at];
        number |= (uint64_t)(byte >> offset & ((1u << count) - 1)) << done;
        done += count;
        offset = 0;
    }
    return number;
}

/* ── checksum ── */

/* As in codec/checksums.py. */
enum { PART_CONSTANT, PART_PAYLOAD, PART_TABLE, PART_COUNTER };
enum { REDUCE_CRC, REDUCE_CRC_REFLECTED, REDUCE_SUM, REDUCE_XOR };
enum { MAX_PARTS = 5 };

typedef struct {
    int kind, size;
    /* A constant; the masks of the payload's bytes, of which those without own bits of others are left out; or the
     * rows of a table by counter. */
    unsigned char bytes[MAX_LENGTH];
    int first, end; /* bytes of the payload that are left out */
} Part;

typedef struct {
    Bits place;
    int kind, width;
    uint32_t init, xor_out;
    uint32_t table[256];
    int count;
    Part parts[MAX_PARTS];
} Checksum;

typedef struct {
    int has_counter, has_checksum;
    Bits counter;
    Checksum checksum;
} Protection;

static uint32_t reverse(uint32_t number, int width)
{
    uint32_t reversed = 0;
    for (int i = 0; i < width; i++)
        reversed |= (number >> i & 1) << (width - 1 - i);
    return reversed;
}

/* The tables of crc_function and _reflected_crc. */
static void prepare_crc(Checksum *checksum, uint32_t poly)
{
    int width = checksum->width;
    uint32_t mask = (uint32_t)mask_of(width), top = 1u << (width - 1);
    bool reflect = checksum->kind == REDUCE_CRC_REFLECTED;
    if (reflect) {
        poly = reverse(poly, width);
        checksum->init = reverse(checksum->init, width);
    }
    for (uint32_t byte = 0; byte < 256; byte++) {
        uint32_t entry = reflect ? byte : byte << (width - 8);
        for (int i = 0; i < 8; i++) {
            if (reflect)
                entry = entry >> 1 ^ (entry & 1 ? poly : 0);
            else
                entry = (entry << 1 ^ (entry & top ? poly : 0)) & mask;
        }
        checksum->table[byte] = entry;
    }
}

static uint32_t reduce(const Checksum *checksum, const unsigned char *bytes, int size)
{
    uint32_t mask = (uint32_t)mask_of(checksum->width), number = checksum->init;
    bool nibbles = checksum->width <= 4;
    for (int i = 0; i < size; i++) {
        unsigned byte = bytes[i];
        switch (checksum->kind) {
        case REDUCE_CRC:
            number = checksum->table[(number >> (checksum->width - 8) ^ byte) & 0xFF] ^ (number << 8 & mask);
            break;
        case REDUCE_CRC_REFLECTED:
            number = checksum->table[(number ^ byte) & 0xFF] ^ number >> 8;
            break;
        case REDUCE_SUM:
            number += nibbles ? (byte >> 4) + (byte & 0x0F) : byte;
            break;
        default:
            number ^= nibbles ? byte >> 4 ^ (byte & 0x0F) : byte;
        }
    }
    if (checksum->kind == REDUCE_SUM)
        number &= mask;
    number ^= checksum->xor_out;
    return checksum->kind == REDUCE_XOR ? number & mask : number;
}

/* The checksum of a payload whose counter is already written. */
static uint32_t compute(const Protection *protection, const unsigned char *data, int length)
{
    const Checksum *checksum = &protection->checksum;
    uint64_t counter = protection->has_counter ? read_bits(data, length, &protection->counter) : 0;
    unsigned char covered[MAX_PARTS * MAX_LENGTH];
    int size = 0;
    for (int i = 0; i < checksum->count; i++) {
        const Part *part = &checksum->parts[i];
        switch (part->kind) {
        case PART_CONSTANT:
            memcpy(covered + size, part->bytes, (size_t)part->size);
            size += part->size;
            break;
        case PART_PAYLOAD:
            for (int at = 0; at < length; at++)
                if (at < part->first || at >= part->end)
                    covered[size++] = data[at] & part->bytes[at];
            break;
        case PART_TABLE:
            covered[size++] = part->bytes[counter % (uint64_t)part->size];
            break;
        default:
            for (int at = 0; at < part->size; at++)
                covered[size++] = (unsigned char)(counter >> 8 * at);
        }
    }
    return reduce(checksum, covered, size);
}

static int refuse(const char *text)
{
    PyErr_SetString(PyExc_ValueError, text);
    return -1;
}

static int read_part(PyObject *item, Part *part, int length)
{
    const char *bytes;
    Py_ssize_t size;
    if (!PyTuple_Check(item) || !PyArg_ParseTuple(item, "iy#ii", &part->kind, &bytes, &size, &part->first, &part->end))
        return PyErr_Occurred() ? -1 : refuse("a part of a checksum is a tuple");
    if (part->kind < PART_CONSTANT || part->kind > PART_COUNTER)
        return refuse("a part of a checksum of an unknown kind");
    if (size > MAX_LENGTH || (part->kind == PART_PAYLOAD && size != length) || (part->kind == PART_TABLE && size < 1) ||
        (part->kind == PART_COUNTER && size > 8))
        return refuse("a part of a checksum does not fit");
    part->size = (int)size;
    memcpy(part->bytes, bytes, (size_t)size);
    return 0;
}

static int read_protection(PyObject *counter, PyObject *checksum, Protection *protection, int length)
{
    if (counter != Py_None) {
        Bits *place = &protection->counter;
        if (!PyArg_ParseTuple(counter, "iip", &place->shift, &place->width, &place->is_big))
            return -1;
        if (!bits_fit(place, length))
            return refuse("the counter is not in the payload");
        protection->has_counter = true;
    }
    if (checksum == Py_None)
        return 0;
    Checksum *own = &protection->checksum;
    unsigned int poly;
    PyObject *parts;
    if (!PyArg_ParseTuple(checksum, "(iip)iiIIIO!", &own->place.shift, &own->place.width, &own->place.is_big, &own->kind,
                          &own->width, &poly, &own->init, &own->xor_out, &PyTuple_Type, &parts))
        return -1;
    bool is_crc = own->kind == REDUCE_CRC || own->kind == REDUCE_CRC_REFLECTED;
    if (!is_crc && own->kind != REDUCE_SUM && own->kind != REDUCE_XOR)
        return refuse("a checksum of an unknown kind");
    if (!bits_fit(&own->place, length) || own->width < (is_crc ? 8 : 1) || own->width > (is_crc ? 16 : 32))
        return refuse("the checksum does not fit");
    if (PyTuple_Size(parts) > MAX_PARTS)
        return refuse("a checksum of too many parts");
    for (Py_ssize_t i = 0; i < PyTuple_Size(parts); i++)
        if (read_part(PyTuple_GetItem(parts, i), &own->parts[i], length) < 0)
            return -1;
    own->count = (int)PyTuple_Size(parts);
    if (is_crc)
        prepare_crc(own, poly);
    protection->has_checksum = true;
    return 0;
}

/* ── fields ── */

enum { IDENTITY, LINEAR };

typedef struct {
    Bits place;
    int is_signed, is_float, is_enumerated;
    int kind;
    double scale, offset, lowest, highest;
    long long raw_lowest, raw_highest;
    int64_t *named; /* the allowed raw numbers, if they leave gaps */
    Py_ssize_t named_count;
} Field;

static int read_named(PyObject *named, Field *field)
{
    if (named == Py_None)
        return 0;
    if (!PyTuple_Check(named))
        return refuse("the named numbers are a tuple or None");
    Py_ssize_t count = PyTuple_Size(named);
    field->named = PyMem_Malloc(((size_t)count + 1) * sizeof *field->named);
    if (field->named == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        field->named[i] = PyLong_AsLongLong(PyTuple_GetItem(named, i));
        if (PyErr_Occurred())
            return -1;
    }
    field->named_count = count;
    return 0;
}

static int read_field(PyObject *item, Field *field, int length)
{
    PyObject *named;
    if (!PyTuple_Check(item))
        return refuse("a field is a tuple");
    if (!PyArg_ParseTuple(item, "(iip)pppiddddLLO", &field->place.shift, &field->place.width, &field->place.is_big,
                          &field->is_signed, &field->is_float, &field->is_enumerated, &field->kind, &field->scale,
                          &field->offset, &field->lowest, &field->highest, &field->raw_lowest, &field->raw_highest,
                          &named))
        return -1;
    int width = field->place.width;
    if (!bits_fit(&field->place, length) || (field->is_float ? width != 32 && width != 64 : width > 53))
        return refuse("a field does not fit");
    return read_named(named, field);
}

static bool is_allowed(const Field *field, int64_t raw)
{
    if (field->named == NULL)
        return field->raw_lowest <= raw && raw <= field->raw_highest;
    for (Py_ssize_t i = 0; i < field->named_count; i++)
        if (field->named[i] == raw)
            return true;
    return false;
}

/* Finds the bits of a value; false if it is not plainly right. */
static bool find_bits(const Field *field, PyObject *object, uint64_t *bits)
{
    double value;
    if (PyFloat_CheckExact(object)) {
        value = PyFloat_AsDouble(object);
    } else if (PyLong_Check(object)) {
        int overflow;
        long long number = PyLong_AsLongLongAndOverflow(object, &overflow);
        value = (double)number;
        if (overflow || !(fabs(value) <= EXACT))
            return false;
    } else {
        return false;
    }
    if (!(field->lowest <= value && value <= field->highest)) /* NaN fails too */
        return false;
    double raw = value;
    if (field->kind == LINEAR)
        raw = field->offset != 0.0 ? (value - field->offset) / field->scale : value / field->scale;
    if (field->is_float) {
        if (!isfinite(value) || !isfinite(raw))
            return false;
        if (field->place.width == 64) {
            memcpy(bits, &raw, sizeof raw);
            return true;
        }
        if (!(fabs(raw) <= (double)FLT_MAX))
            return false;
        float narrow = (float)raw;
        uint32_t narrow_bits;
        memcpy(&narrow_bits, &narrow, sizeof narrow);
        *bits = narrow_bits;
        return true;
    }
    raw = rint(raw); /* halves to even, as Python's round */
    if (!(fabs(raw) <= EXACT) || (field->is_enumerated && raw != value) || !is_allowed(field, (int64_t)raw))
        return false;
    *bits = (uint64_t)(int64_t)raw & mask_of(field->place.width);
    return true;
}

/* ── Packer ── */

typedef struct {
    PyObject_HEAD
    int length;
    unsigned char base[MAX_LENGTH];
    Protection protection;
    Py_ssize_t count;
    Field *fields;
} Packer;

static void packer_dealloc(PyObject *object)
{
    Packer *self = (Packer *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (Py_ssize_t i = 0; self->fields != NULL && i < self->count; i++)
        PyMem_Free(self->fields[i].named);
    PyMem_Free(self->fields);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

static PyObject *packer_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    const char *base;
    Py_ssize_t length;
    PyObject *fields, *counter, *checksum;
    if (keywords != NULL && PyDict_Size(keywords) > 0) {
        PyErr_SetString(PyExc_TypeError, "Packer takes no keywords");
        return NULL;
    }
    if (!PyArg_ParseTuple(arguments, "y#O!OO", &base, &length, &PyTuple_Type, &fields, &counter, &checksum))
        return NULL;
    if (length > MAX_LENGTH) {
        refuse("a payload has at most 64 bytes");
        return NULL;
    }
    Packer *self = (Packer *)((allocfunc)PyType_GetSlot(type, Py_tp_alloc))(type, 0);
    if (self == NULL)
        return NULL;
    self->length = (int)length;
    memcpy(self->base, base, (size_t)length);
    Py_ssize_t count = PyTuple_Size(fields);
    self->fields = PyMem_Calloc((size_t)count + 1, sizeof *self->fields);
    if (self->fields == NULL) {
        Py_DECREF(self);
        return PyErr_NoMemory();
    }
    self->count = count;
    int failed = read_protection(counter, checksum, &self->protection, self->length);
    for (Py_ssize_t i = 0; i < count && !failed; i++)
        failed = read_field(PyTuple_GetItem(fields, i), &self->fields[i], self->length);
    if (failed) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

/* pack(values, counter) → the payload, or None where Python decides. */
static PyObject *packer_pack(PyObject *object, PyObject *const *arguments, Py_ssize_t count)
{
    const Packer *self = (const Packer *)object;
    if (count != 2 || !PyLong_Check(arguments[1])) {
        PyErr_SetString(PyExc_TypeError, "pack(values, counter: int)");
        return NULL;
    }
    PyObject *values = arguments[0];
    if (!PyTuple_CheckExact(values) || PyTuple_Size(values) != self->count)
        Py_RETURN_NONE;
    unsigned char data[MAX_LENGTH];
    memcpy(data, self->base, (size_t)self->length);
    for (Py_ssize_t i = 0; i < self->count; i++) {
        uint64_t bits;
        if (!find_bits(&self->fields[i], PyTuple_GetItem(values, i), &bits))
            Py_RETURN_NONE;
        write_bits(data, self->length, &self->fields[i].place, bits);
    }
    const Protection *protection = &self->protection;
    if (protection->has_counter) {
        int overflow;
        long long number = PyLong_AsLongLongAndOverflow(arguments[1], &overflow);
        if (overflow || number < 0 || (uint64_t)number > mask_of(protection->counter.width))
            Py_RETURN_NONE;
        write_bits(data, self->length, &protection->counter, (uint64_t)number);
    }
    if (protection->has_checksum) {
        uint32_t sum = compute(protection, data, self->length);
        if (sum > mask_of(protection->checksum.place.width))
            Py_RETURN_NONE;
        write_bits(data, self->length, &protection->checksum.place, sum);
    }
    return PyBytes_FromStringAndSize((const char *)data, self->length);
}

static PyMethodDef packer_methods[] = {
    {"pack", (PyCFunction)(void (*)(void))packer_pack, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot packer_slots[] = {
    {Py_tp_new, packer_new},
    {Py_tp_dealloc, packer_dealloc},
    {Py_tp_methods, packer_methods},
    {0, NULL},
};

PyType_Spec packer_spec = {
    .name = "vehicle_iface._wire.Packer",
    .basicsize = sizeof(Packer),
    .flags = Py_TPFLAGS_DEFAULT,
    .slots = packer_slots,
};
