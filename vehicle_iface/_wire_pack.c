/* Payloads from values in C: what codec/encoder.py does in Python for a message without multiplexer, whose signals have
 * at most 53 bits. codec/c_codec.py describes the message. The answer is None for every value that is not plainly right:
 * the Python code then decides.
 */
#include "_wire.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* ── values ── */

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
    if (field->kind != IDENTITY)
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
        PyMem_Free(self->fields[i].named.items);
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
        uint32_t sum = compute_checksum(protection, data, self->length);
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
