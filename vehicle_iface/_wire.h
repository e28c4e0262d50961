/* What the files of the C code share. */
#ifndef VEHICLE_IFACE_WIRE_H
#define VEHICLE_IFACE_WIRE_H

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include <stdbool.h>
#include <stdint.h>

/* The fields of CanFrame, in order. */
enum { CAN_ID, DATA, STAMP_NS, IS_EXTENDED, IS_REMOTE, IS_FD, IS_ERROR, BUS, FRAME_FIELDS };

/* ── _wire.c ── */

PyObject *new_tuple_of(PyTypeObject *type, PyObject *fields);
PyTypeObject *require_tuple_type(PyObject *type);

/* ── _wire_payload.c ── */

enum { MAX_LENGTH = 64, MAX_PARTS = 5 };

/* A double holds every integer up to here. */
#define EXACT 9007199254740992.0

/* Bits are counted from the least significant one of the payload, read as one integer of this byte order. */
typedef struct {
    int shift, width, is_big;
} Bits;

bool bits_fit(const Bits *bits, int length);
uint64_t mask_of(int width);
void write_bits(unsigned char *data, int length, const Bits *bits, uint64_t number);
uint64_t read_bits(const unsigned char *data, int length, const Bits *bits);

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

/* Reads a ProtectionRecipe of codec/protection.py; returns -1 with an error set. */
int read_protection(PyObject *counter, PyObject *checksum, Protection *protection, int length);

/* The checksum of a payload whose counter is already written. */
uint32_t compute_checksum(const Protection *protection, const unsigned char *data, int length);

/* A tuple of integers, or None. */
typedef struct {
    int64_t *items; /* NULL for None */
    Py_ssize_t count;
} Numbers;

int read_numbers(PyObject *object, Numbers *numbers);
Py_ssize_t find_number(const Numbers *numbers, int64_t number); /* its place; -1 where it is not there */

/* A signal: its value is the raw number, or scale · raw + offset, computed in doubles or in integers. */
enum { IDENTITY, LINEAR, WHOLE };

typedef struct {
    Bits place;
    int is_signed, is_float, is_enumerated;
    int kind;
    double scale, offset, lowest, highest;
    long long raw_lowest, raw_highest;
    Numbers named; /* the allowed raw numbers, if they leave gaps */
} Field;

int read_field(PyObject *item, Field *field, int length);
bool is_allowed(const Field *field, int64_t raw);

/* Sets a ValueError; returns -1. */
int refuse(const char *text);

/* ── the types of the module ── */

extern PyType_Spec packer_spec, unpacker_spec;

#endif
