/* Messages from received frames in C: what codec/decoder.py does in Python, for the usual frame of a message without
 * multiplexer: intact, with the expected counter, and with every value in its range. codec/c_codec.py describes the
 * message. The answer is None for every other frame: the Python code then decides. It alone keeps the counters.
 */
#include "_wire.h"

#include <math.h>
#include <string.h>

/* ── values ── */

typedef struct {
    Field field;
    Numbers raws, numbers; /* what each raw number of an enumeration means, if that is another number */
    Numbers missing;       /* raw numbers that mean that there is no value */
    int is_converted;      /* to another unit: value · unit_scale + unit_offset */
    double unit_scale, unit_offset;
} Input;

static void free_input(Input *input)
{
    PyMem_Free(input->field.named.items);
    PyMem_Free(input->raws.items);
    PyMem_Free(input->numbers.items);
    PyMem_Free(input->missing.items);
}

static int read_input(PyObject *item, Input *input, int length)
{
    PyObject *field, *raws, *numbers, *missing;
    if (!PyTuple_Check(item))
        return refuse("a received signal is a tuple");
    if (!PyArg_ParseTuple(item, "OOOOpdd", &field, &raws, &numbers, &missing, &input->is_converted, &input->unit_scale,
                          &input->unit_offset) ||
        read_field(field, &input->field, length) < 0 || read_numbers(raws, &input->raws) < 0 ||
        read_numbers(numbers, &input->numbers) < 0 || read_numbers(missing, &input->missing) < 0)
        return -1;
    if (input->raws.count != input->numbers.count)
        return refuse("there is a number for each raw one");
    if (input->field.kind == WHOLE && !(fabs(input->field.scale) <= EXACT && fabs(input->field.offset) <= EXACT))
        return refuse("scale and offset of integers have at most 53 bits");
    return 0;
}

static PyObject *make_float(const Input *input, double value)
{
    if (input->is_converted) {
        value *= input->unit_scale;
        if (input->unit_offset != 0.0)
            value += input->unit_offset;
    }
    return PyFloat_FromDouble(value);
}

static PyObject *make_integer(const Input *input, int64_t value)
{
    return input->is_converted ? make_float(input, (double)value) : PyLong_FromLongLong(value);
}

/* Finds the value of a float signal; false if it is not plainly right. */
static bool find_float(const Input *input, uint64_t bits, PyObject **value)
{
    const Field *field = &input->field;
    double number;
    if (field->place.width == 64) {
        memcpy(&number, &bits, sizeof number);
    } else {
        uint32_t narrow_bits = (uint32_t)bits;
        float narrow;
        memcpy(&narrow, &narrow_bits, sizeof narrow);
        number = narrow;
    }
    if (field->kind != IDENTITY)
        number = field->scale * number + field->offset;
    if (!isfinite(number) || !(field->lowest <= number && number <= field->highest))
        return false;
    *value = make_float(input, number);
    return true;
}

/* Finds the value of an integer signal; false if it is not plainly right. */
static bool find_integer(const Input *input, uint64_t bits, PyObject **value)
{
    const Field *field = &input->field;
    int64_t raw = (int64_t)bits;
    if (field->is_signed && bits >> (field->place.width - 1))
        raw -= (int64_t)1 << field->place.width;
    if (!is_allowed(field, raw) || find_number(&input->missing, raw) >= 0)
        return false;
    if (input->raws.items != NULL) {
        Py_ssize_t at = find_number(&input->raws, raw);
        if (at < 0)
            return false;
        raw = input->numbers.items[at];
    }
    if (field->kind == LINEAR) {
        double number = field->scale * (double)raw;
        if (field->offset != 0.0 || field->scale < 0.0)
            number += field->offset;
        *value = make_float(input, number);
        return true;
    }
    int64_t whole = raw;
    if (field->kind == WHOLE && (__builtin_mul_overflow((int64_t)field->scale, raw, &whole) ||
                                 __builtin_add_overflow(whole, (int64_t)field->offset, &whole)))
        return false;
    *value = make_integer(input, whole);
    return true;
}

static bool find_value(const Input *input, const unsigned char *data, int length, PyObject **value)
{
    uint64_t bits = read_bits(data, length, &input->field.place);
    return input->field.is_float ? find_float(input, bits, value) : find_integer(input, bits, value);
}

/* ── Unpacker ── */

typedef struct {
    PyObject_HEAD
    PyTypeObject *message_type; /* DecodedMessage */
    PyObject *name;
    int length, is_fd;
    Protection protection;
    Py_ssize_t count;
    Input *inputs;
} Unpacker;

static void unpacker_dealloc(PyObject *object)
{
    Unpacker *self = (Unpacker *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (Py_ssize_t i = 0; self->inputs != NULL && i < self->count; i++)
        free_input(&self->inputs[i]);
    PyMem_Free(self->inputs);
    Py_XDECREF((PyObject *)self->message_type);
    Py_XDECREF(self->name);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

static PyObject *unpacker_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    PyObject *message_type, *name, *inputs, *counter, *checksum;
    int length, is_fd;
    if (keywords != NULL && PyDict_Size(keywords) > 0) {
        PyErr_SetString(PyExc_TypeError, "Unpacker takes no keywords");
        return NULL;
    }
    if (!PyArg_ParseTuple(arguments, "OUipO!OO", &message_type, &name, &length, &is_fd, &PyTuple_Type, &inputs,
                          &counter, &checksum) ||
        require_tuple_type(message_type) == NULL)
        return NULL;
    if (length < 0 || length > MAX_LENGTH) {
        refuse("a payload has at most 64 bytes");
        return NULL;
    }
    Unpacker *self = (Unpacker *)((allocfunc)PyType_GetSlot(type, Py_tp_alloc))(type, 0);
    if (self == NULL)
        return NULL;
    self->message_type = (PyTypeObject *)Py_NewRef(message_type);
    self->name = Py_NewRef(name);
    self->length = length;
    self->is_fd = is_fd;
    Py_ssize_t count = PyTuple_Size(inputs);
    self->inputs = PyMem_Calloc((size_t)count + 1, sizeof *self->inputs);
    if (self->inputs == NULL) {
        Py_DECREF(self);
        return PyErr_NoMemory();
    }
    self->count = count;
    int failed = read_protection(counter, checksum, &self->protection, length);
    for (Py_ssize_t i = 0; i < count && !failed; i++)
        failed = read_input(PyTuple_GetItem(inputs, i), &self->inputs[i], length);
    if (failed) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

/* The payload of a frame of the message's kind and length; NULL for any other. */
static const unsigned char *find_payload(const Unpacker *self, PyObject *frame)
{
    PyObject *data = PyTuple_GetItem(frame, DATA);
    if (PyTuple_GetItem(frame, IS_REMOTE) != Py_False || PyTuple_GetItem(frame, IS_ERROR) != Py_False ||
        PyTuple_GetItem(frame, IS_FD) != (self->is_fd ? Py_True : Py_False) || !PyBytes_CheckExact(data) ||
        PyBytes_Size(data) != self->length)
        return NULL;
    return (const unsigned char *)PyBytes_AsString(data);
}

static bool is_expected(const Protection *protection, const unsigned char *data, int length, PyObject *counter)
{
    if (protection->has_counter) {
        int overflow;
        long long number = PyLong_AsLongLongAndOverflow(counter, &overflow);
        if (overflow || number < 0 || read_bits(data, length, &protection->counter) != (uint64_t)number)
            return false;
    }
    return !protection->has_checksum ||
           compute_checksum(protection, data, length) == read_bits(data, length, &protection->checksum.place);
}

/* A tuple of all values. NULL without an error: one of them is not plainly right. */
static PyObject *make_values(const Unpacker *self, const unsigned char *data)
{
    PyObject *values = PyTuple_New(self->count);
    for (Py_ssize_t i = 0; values != NULL && i < self->count; i++) {
        PyObject *value = NULL;
        if (!find_value(&self->inputs[i], data, self->length, &value) || value == NULL)
            Py_CLEAR(values);
        else
            PyTuple_SetItem(values, i, value); /* cannot fail: new, and the place is in it */
    }
    return values;
}

/* unpack(frame, counter) → the message of a frame with this counter, or None where Python decides. */
static PyObject *unpacker_unpack(PyObject *object, PyObject *const *arguments, Py_ssize_t count)
{
    const Unpacker *self = (const Unpacker *)object;
    if (count != 2 || !PyTuple_Check(arguments[0]) || PyTuple_Size(arguments[0]) != FRAME_FIELDS ||
        !PyLong_Check(arguments[1])) {
        PyErr_SetString(PyExc_TypeError, "unpack(frame: CanFrame, counter: int)");
        return NULL;
    }
    PyObject *frame = arguments[0], *counter = arguments[1];
    const unsigned char *data = find_payload(self, frame);
    if (data == NULL || !is_expected(&self->protection, data, self->length, counter))
        Py_RETURN_NONE;
    PyObject *values = make_values(self, data);
    if (values == NULL) {
        if (PyErr_Occurred())
            return NULL;
        Py_RETURN_NONE;
    }
    PyObject *fields = PyTuple_Pack(4, self->name, PyTuple_GetItem(frame, STAMP_NS), counter, values);
    Py_DECREF(values);
    return new_tuple_of(self->message_type, fields);
}

static PyMethodDef unpacker_methods[] = {
    {"unpack", (PyCFunction)(void (*)(void))unpacker_unpack, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot unpacker_slots[] = {
    {Py_tp_new, unpacker_new},
    {Py_tp_dealloc, unpacker_dealloc},
    {Py_tp_methods, unpacker_methods},
    {0, NULL},
};

PyType_Spec unpacker_spec = {
    .name = "vehicle_iface._wire.Unpacker",
    .basicsize = sizeof(Unpacker),
    .flags = Py_TPFLAGS_DEFAULT,
    .slots = unpacker_slots,
};
