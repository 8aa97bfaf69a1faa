/* Version of the library, by semantic versioning. */
#ifndef PLUMB_VERSION_H
#define PLUMB_VERSION_H

#define PLUMB_VERSION_MAJOR 0
#define PLUMB_VERSION_MINOR 1
#define PLUMB_VERSION_PATCH 0
#define PLUMB_VERSION       "0.1.0"

#endif
