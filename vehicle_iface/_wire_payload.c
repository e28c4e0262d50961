/* What packing and unpacking of payloads share: bits, protection, and the description of a signal. */
#include "_wire.h"

#include <string.h>

int refuse(const char *text)
{
    PyErr_SetString(PyExc_ValueError, text);
    return -1;
}

/* ── numbers ── */

int read_numbers(PyObject *object, Numbers *numbers)
{
    if (object == Py_None)
        return 0;
    if (!PyTuple_Check(object))
        return refuse("a list of numbers is a tuple or None");
    Py_ssize_t count = PyTuple_Size(object);
    numbers->items = PyMem_Malloc(((size_t)count + 1) * sizeof *numbers->items);
    if (numbers->items == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        numbers->items[i] = PyLong_AsLongLong(PyTuple_GetItem(object, i));
        if (PyErr_Occurred())
            return -1;
    }
    numbers->count = count;
    return 0;
}

Py_ssize_t find_number(const Numbers *numbers, int64_t number)
{
    for (Py_ssize_t i = 0; i < numbers->count; i++)
        if (numbers->items[i] == number)
            return i;
    return -1;
}

/* ── bits ── */

bool bits_fit(const Bits *bits, int length)
{
    return bits->shift >= 0 && bits->width >= 1 && bits->width <= 64 && bits->shift <= 8 * length - bits->width;
}

uint64_t mask_of(int width)
{
    return width >= 64 ? UINT64_MAX : ((uint64_t)1 << width) - 1;
}

void write_bits(unsigned char *data, int length, const Bits *bits, uint64_t number)
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

uint64_t read_bits(const unsigned char *data, int length, const Bits *bits)
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

uint32_t compute_checksum(const Protection *protection, const unsigned char *data, int length)
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

int read_protection(PyObject *counter, PyObject *checksum, Protection *protection, int length)
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

int read_field(PyObject *item, Field *field, int length)
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
    return read_numbers(named, &field->named);
}

bool is_allowed(const Field *field, int64_t raw)
{
    if (field->named.items == NULL)
        return field->raw_lowest <= raw && raw <= field->raw_highest;
    return find_number(&field->named, raw) >= 0;
}
