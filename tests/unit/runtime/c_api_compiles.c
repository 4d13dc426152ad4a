/* SPDX-License-Identifier: Apache-2.0 */
/* Built as strict C99: the header must be one that C can include, and the calls must link. */
#include "envbake/envbake.h"

int use_from_c(const char* path, float* irradiance_up, float* first_exit, size_t* vertex_count);

int use_from_c(const char* path, float* irradiance_up, float* first_exit, size_t* vertex_count) {
    static const float up[3] = {0, 1, 0};
    envbake_error error;
    envbake_bundle* bundle = envbake_open_file(path, &error);
    int code;
    if (bundle == NULL) return error.code;
    envbake_irradiance(bundle, up, irradiance_up);
    *vertex_count = envbake_mesh_vertex_count(bundle, 0);
    code = envbake_diffuse(bundle, 0, 0, 1, first_exit, NULL);
    envbake_close(bundle);
    return code;
}
