/* SPDX-License-Identifier: Apache-2.0 */
/* The same as main.cpp, from C. */
#include "envbake/envbake.h"

#include <stdio.h>

static void print(const char* what, const float rgb[3]) {
    printf("%-34s %10.4f %10.4f %10.4f\n", what, (double)rgb[0], (double)rgb[1], (double)rgb[2]);
}

int main(int argc, char** argv) {
    static const float up[3] = {0, 1, 0}, down[3] = {0, -1, 0};
    static const float view[3] = {0.866025404f, 0.5f, 0}, r0[3] = {0.04f, 0.04f, 0.04f};
    envbake_error error;
    envbake_bundle* bundle;
    float rgb[3];

    if (argc != 2) {
        fprintf(stderr, "usage: %s OUT.envb\n", argv[0]);
        return 2;
    }
    bundle = envbake_open_file(argv[1], &error);
    if (bundle == NULL) {
        fprintf(stderr, "%s: %s %s\n", argv[1], error.message, error.array);
        return 4;
    }
    envbake_irradiance(bundle, up, rgb);
    print("irradiance, facing up", rgb);
    envbake_irradiance(bundle, down, rgb);
    print("irradiance, facing down", rgb);
    envbake_specular(bundle, up, view, 0.5f, r0, rgb);
    print("specular, roughness 0.5", rgb);
    if (envbake_diffuse(bundle, 0, 0, 1, rgb, NULL) == 0) print("exit radiance, first vertex", rgb);
    envbake_close(bundle);
    return 0;
}
