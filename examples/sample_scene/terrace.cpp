// SPDX-License-Identifier: Apache-2.0
#include "scene.h"

#include <numbers>
#include <string_view>
#include <utility>

namespace envbake::sample {
namespace {

constexpr double kFloor = 0.24;  ///< height of the terrace above the ground, m
constexpr int kRound = 192;      ///< segments of the large circles

Vec3 on_floor(double radius, double azimuth_deg, double y = kFloor) {
    const double azimuth = azimuth_deg * std::numbers::pi / 180;
    return {radius * std::cos(azimuth), y, radius * std::sin(azimuth)};
}

class Composer {
  public:
    int material(std::string_view name, Vec3 base_color, double metallic, double roughness) {
        scene_.materials.push_back({std::string(name), base_color, metallic, roughness});
        return static_cast<int>(scene_.materials.size()) - 1;
    }
    int mesh(std::string_view name, int material, Mesh mesh) {
        scene_.meshes.push_back({std::string(name), material, std::move(mesh)});
        return static_cast<int>(scene_.meshes.size()) - 1;
    }
    void place(std::string name, int mesh, Vec3 where = {}, double yaw_deg = 0) {
        scene_.nodes.push_back({std::move(name), mesh, where, yaw_deg});
    }
    Scene take() { return std::move(scene_); }

  private:
    Scene scene_;
};

Mesh lathe(const std::vector<Profile>& profiles, int segments, double from_deg = 0,
           double to_deg = 360) {
    Mesh mesh;
    for (const Profile& profile : profiles) add_lathe(mesh, profile, segments, from_deg, to_deg);
    return mesh;
}

void add_ground(Composer& scene) {
    const int gravel = scene.material("gravel", {0.33, 0.29, 0.24}, 0, 0.95);
    const int limestone = scene.material("limestone", {0.62, 0.57, 0.49}, 0, 0.7);
    const int marble = scene.material("marble", {0.74, 0.72, 0.68}, 0, 0.35);
    const int slate = scene.material("slate", {0.09, 0.10, 0.12}, 0, 0.3);

    const double tread = kFloor / 2;
    const Mesh ground =
        lathe({line({0, -0.3, 0}, {3.84, -0.3, 0}, 2), line({3.9, -0.3, 0}, {3.9, -0.06, 0}, 0.08),
               arc({3.84, -0.06, 0}, 0.06, 0, 90, 4), line({3.84, 0, 0}, {3.3, 0, 0}, 0.06)},
              kRound);
    const Mesh steps = lathe(
        {line({3.3, 0, 0}, {3.3, tread, 0}, 0.06), line({3.3, tread, 0}, {2.98, tread, 0}, 0.05),
         line({2.98, tread, 0}, {2.98, kFloor, 0}, 0.06),
         line({2.98, kFloor, 0}, {2.86, kFloor, 0}, 0.04)},
        kRound);
    const Mesh floor = lathe({line({2.86, kFloor, 0}, {1.32, kFloor, 0}, 0.045),
                              line({1.16, kFloor, 0}, {0, kFloor, 0}, 0.045)},
                             kRound);
    const Mesh inlay = lathe({line({1.32, kFloor, 0}, {1.16, kFloor, 0}, 0.04)}, kRound);
    scene.place("ground", scene.mesh("ground", gravel, ground));
    scene.place("steps", scene.mesh("steps", limestone, steps));
    scene.place("floor", scene.mesh("floor", marble, floor));
    scene.place("inlay", scene.mesh("inlay", slate, inlay));
}

void add_colonnade(Composer& scene) {
    const int stone = scene.material("sandstone", {0.70, 0.60, 0.46}, 0, 0.8);
    const double ring = 2.5, height = 1.95;
    const Mesh column = lathe(
        {line({0.23, 0, 0}, {0.23, 0.07, 0}, 0.035), line({0.23, 0.07, 0}, {0.20, 0.07, 0}, 0.03),
         arc({0.175, 0.105, 0}, 0.035, -90, 90, 6),
         // The shaft swells by a centimetre on its way up (entasis).
         arc({-13.0, 0.7, 0}, 13.165, -2.4, 4.7, 16), arc({0.115, 1.79, 0}, 0.03, -60, 90, 5),
         line({0.13, 1.82, 0}, {0.21, 1.87, 0}, 0.03),
         line({0.21, 1.87, 0}, {0.21, height, 0}, 0.04),
         line({0.21, height, 0}, {0, height, 0}, 0.12)},
        32);
    const int column_mesh = scene.mesh("column", stone, column);
    constexpr int kColumns = 8;
    constexpr double kFirst = 148, kLast = 322;
    for (int i = 0; i < kColumns; ++i) {
        scene.place("column " + std::to_string(i + 1), column_mesh,
                    on_floor(ring, kFirst + (kLast - kFirst) * i / (kColumns - 1)), 15.0 * i);
    }

    const double y0 = kFloor + height, y1 = y0 + 0.2, y2 = y0 + 0.27;
    const double from = kFirst - 7, to = kLast + 7;
    Mesh beam = lathe({line({ring - 0.19, y0, 0}, {ring + 0.19, y0, 0}, 0.06),
                       line({ring + 0.19, y0, 0}, {ring + 0.19, y1, 0}, 0.05),
                       line({ring + 0.19, y1, 0}, {ring + 0.27, y1, 0}, 0.04),
                       line({ring + 0.27, y1, 0}, {ring + 0.27, y2, 0}, 0.04),
                       line({ring + 0.27, y2, 0}, {ring - 0.27, y2, 0}, 0.07),
                       line({ring - 0.27, y2, 0}, {ring - 0.27, y1, 0}, 0.04),
                       line({ring - 0.27, y1, 0}, {ring - 0.19, y1, 0}, 0.04),
                       line({ring - 0.19, y1, 0}, {ring - 0.19, y0, 0}, 0.05)},
                      120, from, to);
    for (const double end : {from, to}) {
        const Vec3 outwards = on_floor(end == from ? -1 : 1, end + 90, 0);
        const auto cap = [&](double half_width, double low, double high, int rows) {
            add_patch(beam, rows, 6, false, [&](int i, int j) {
                const double radius = ring + half_width * (j / 3.0 - 1);
                return SurfaceSample{on_floor(radius, end, low + (high - low) * i / rows),
                                     outwards};
            });
        };
        cap(0.19, y0, y1, 4);
        cap(0.27, y1, y2, 2);
    }
    scene.place("entablature", scene.mesh("entablature", stone, std::move(beam)));
}

void add_sculpture(Composer& scene) {
    const int basalt = scene.material("basalt", {0.05, 0.05, 0.055}, 0, 0.2);
    const int gold = scene.material("gold", {1.0, 0.76, 0.33}, 1, 0.16);
    const Mesh pedestal = lathe(
        {line({0.52, 0, 0}, {0.52, 0.08, 0}, 0.04), line({0.52, 0.08, 0}, {0.46, 0.08, 0}, 0.04),
         arc({0.66, 0.28, 0}, 0.28, 225, 135, 10, true),
         line({0.46, 0.48, 0}, {0.46, 0.56, 0}, 0.04), line({0.46, 0.56, 0}, {0, 0.56, 0}, 0.045)},
        72);
    scene.place("pedestal", scene.mesh("pedestal", basalt, pedestal), {0, kFloor, 0});
    scene.place("trefoil",
                scene.mesh("trefoil", gold, make_torus_knot(2, 3, 0.44, 0.21, 0.125, 300, 24)),
                {0, kFloor + 0.56 + 0.72, 0}, 40);
}

void add_objects(Composer& scene) {
    const double ramp[] = {0.05, 0.2, 0.4, 0.6, 0.9};
    for (int i = 0; i < 5; ++i) {
        const std::string name = "copper " + std::to_string(i + 1);
        const int copper = scene.material(name, {0.96, 0.58, 0.44}, 1, ramp[i]);
        scene.place(name, scene.mesh(name, copper, make_sphere(0.24, 44)),
                    on_floor(2.1, 88 - 19.0 * i, kFloor + 0.24));
    }
    const int lacquer = scene.material("red lacquer", {0.55, 0.025, 0.02}, 0, 0.12);
    const int blue = scene.material("blue lacquer", {0.02, 0.07, 0.30}, 0, 0.25);
    const int large =
        scene.mesh("large box", lacquer, make_rounded_box({0.62, 0.42, 0.62}, 0.04, 12, 3));
    const int small =
        scene.mesh("small box", blue, make_rounded_box({0.34, 0.34, 0.34}, 0.03, 10, 3));
    scene.place("large box", large, on_floor(1.85, 128, kFloor + 0.21), 20);
    scene.place("small box", small, on_floor(1.88, 127, kFloor + 0.42 + 0.17), 52);

    const int clay = scene.material("terracotta", {0.52, 0.20, 0.10}, 0, 0.9);
    const Mesh vase = lathe(
        {line({0, 0, 0}, {0.15, 0, 0}, 0.08), arc({0.05, 0.30, 0}, 0.27, -60, 52, 18),
         arc({0.345, 0.62, 0}, 0.17, 220, 150, 8, true), arc({0.178, 0.712, 0}, 0.022, -20, 180, 6),
         arc({0.345, 0.62, 0}, 0.19, 150, 215, 8), line({0.189, 0.51, 0}, {0, 0.36, 0}, 0.06)},
        64);
    scene.place("vase", scene.mesh("vase", clay, vase), on_floor(1.8, -18));
    const int glaze = scene.material("celadon", {0.20, 0.42, 0.33}, 0, 0.18);
    scene.place("ring", scene.mesh("ring", glaze, make_torus(0.29, 0.085, 64, 24)),
                on_floor(1.3, 8, kFloor + 0.085));
}

}  // namespace

Scene make_terrace() {
    Composer scene;
    add_ground(scene);
    add_colonnade(scene);
    add_sculpture(scene);
    add_objects(scene);
    return scene.take();
}

}  // namespace envbake::sample
