/* SPDX-License-Identifier: Apache-2.0 */
#ifndef ENVBAKE_ENVBAKE_H
#define ENVBAKE_ENVBAKE_H

/* The runtime for C, and for everything that can call C. The same functions as
 * envbake/runtime/bundle.h and shade.h, where the conventions are spelled out:
 *
 *   directions  float[3], unit, glTF world space (right-handed, +Y up), away from the surface
 *   colours     float[3], linear RGB, Rec. 709 primaries
 *   roughness   perceptual, 0 .. 1
 *
 * A bundle may be used by any number of threads at once; only envbake_close() must come last.
 * Nothing allocates but the two open functions. There is no global state.
 */

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct envbake_bundle envbake_bundle;

/* What went wrong. Every `error` parameter may be NULL; it is written only on failure. */
typedef struct envbake_error {
    int32_t code;         /* envbake::format::Errc, stable: docs/format.md lists them; never 0 */
    int32_t system_error; /* errno, where the operating system refused; else 0 */
    uint64_t offset;      /* bytes into the file where the fault is seen; 0 if nowhere */
    char array[64];       /* name of the array concerned, cut to 63 characters; "" if none */
    char message[160];    /* one sentence for a person */
} envbake_error;

/* Opens a bundle; NULL on failure. Memory is borrowed: it must be 8-byte aligned and outlive the
 * bundle. Closing NULL does nothing. */
envbake_bundle* envbake_open_file(const char* path, envbake_error* error);
envbake_bundle* envbake_open_memory(const void* bytes, size_t size, envbake_error* error);
void envbake_close(envbake_bundle* bundle);

/* Irradiance on a surface that faces `normal`, W m^-2; 0 without lighting. May be negative. */
void envbake_irradiance(const envbake_bundle* bundle, const float normal[3], float rgb[3]);

/* Reflected radiance of the specular lobe: prefiltered environment times split-sum table; 0
 * without either. `r0`: reflectance at normal incidence. */
void envbake_specular(const envbake_bundle* bundle, const float normal[3], const float view[3],
                      float roughness, const float r0[3], float rgb[3]);

/* Prefiltered radiance along a direction, and A and B of the specular albedo r0 A + B. */
void envbake_sample_mips(const envbake_bundle* bundle, const float direction[3], float roughness,
                         float rgb[3]);
void envbake_lookup_brdf(const envbake_bundle* bundle, float n_dot_v, float roughness,
                         float a_b[2]);

/* The (node, primitive) pairs of the default scene, depth first, in file order. 0 vertices for a
 * mesh that does not exist. */
size_t envbake_mesh_count(const envbake_bundle* bundle);
size_t envbake_mesh_vertex_count(const envbake_bundle* bundle, size_t mesh);

/* Exit radiance, for albedo 1, of `count` vertices from `first` on: rgb[3 * count]. Returns 0, or
 * the error code: ArrayMissing (40) when this mesh has no diffuse transport, BufferSize (44) when
 * the range leaves the mesh. */
int envbake_diffuse(const envbake_bundle* bundle, size_t mesh, size_t first, size_t count,
                    float* rgb, envbake_error* error);

enum {
    ENVBAKE_F32 = 0,
    ENVBAKE_F16 = 1,
    ENVBAKE_U8 = 2,
    ENVBAKE_U16 = 3,
    ENVBAKE_U32 = 4,
    ENVBAKE_I8 = 5,
    ENVBAKE_I16 = 6
};

/* An array of any name. */
typedef struct envbake_array {
    const void* data;  /* in place, valid until the bundle is closed; NULL when compressed */
    uint64_t size;     /* bytes, decoded */
    uint64_t shape[6]; /* elements along each axis, slowest first; 0 beyond `rank` */
    int32_t rank;      /* 1 .. 6 */
    int32_t type;      /* ENVBAKE_F32 ... */
} envbake_array;

/* Describes an array. Returns 0, or ArrayMissing (40). */
int envbake_find_array(const envbake_bundle* bundle, const char* name, envbake_array* array,
                       envbake_error* error);

/* Copies or decodes an array into memory of exactly its size. Returns 0, or ArrayMissing (40),
 * BufferSize (44), ArrayDecode (31), ArrayCodec (43). */
int envbake_read_array(const envbake_bundle* bundle, const char* name, void* memory, size_t size,
                       envbake_error* error);

/* The metadata: JSON in UTF-8, not terminated by a 0; NULL and size 0 when there is none. */
const char* envbake_metadata(const envbake_bundle* bundle, size_t* size);

#ifdef __cplusplus
}
#endif

#endif
