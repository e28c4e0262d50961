/* The types of _wire_codec.c, for the module in _wire.c. */
#ifndef VEHICLE_IFACE_WIRE_H
#define VEHICLE_IFACE_WIRE_H

extern PyType_Spec packer_spec;

#endif
