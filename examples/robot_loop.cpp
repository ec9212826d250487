// An exported controller in a control loop at 1 kHz, with a camera's frames in OpenCV's axes; docs/export.md explains it.
//
//   archerfish export --controller kalman-lq --tuning start --out policy.c
//   cc -std=c99 -O3 -c policy.c && c++ -std=c++17 -O3 robot_loop.cpp policy.o -lm -o robot_loop && ./robot_loop
//
// Gimbal, camera and target are simulated: the paper's gimbal, and a plate at 3 m that swings to both sides. It prints
// shots and hits.
#include "policy.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <random>

struct Angles {
  double time;  // [s]
  float pitch, yaw;
};

// The gimbal's angles of the last half second, from which those at an exposure are taken.
class History {
 public:
  void add(const Angles &now) { ring_[++last_ % ring_.size()] = now; }
  Angles at(double time) const {
    std::size_t k = last_;
    while (k > 1 && k + ring_.size() > last_ + 2 && ring_[(k - 1) % ring_.size()].time > time) --k;
    const Angles &after = ring_[k % ring_.size()], &before = ring_[(k - 1) % ring_.size()];
    const float part = static_cast<float>((time - before.time) / (after.time - before.time));
    return {time, before.pitch + part * (after.pitch - before.pitch), before.yaw + part * (after.yaw - before.yaw)};
  }

 private:
  std::array<Angles, 512> ring_{};
  std::size_t last_ = 0;
};

// From a camera's optical frame (x right, y down, z ahead) to the frame of policy_seen (x forward, y left, z up) [m].
// at: the gimbal's angles at the exposure; lever: the camera from the pivot, forward, left and up, at angles of 0.
static void plate_from_camera(const float optical[3], const Angles &at, const float lever[3], float plate[3]) {
  const float ahead = optical[2] + lever[0], left = -optical[0] + lever[1], up = -optical[1] + lever[2];
  const float level = std::cos(at.pitch) * ahead - std::sin(at.pitch) * up;  // pitch is positive upwards
  plate[0] = std::cos(at.yaw) * level - std::sin(at.yaw) * left;             // yaw is positive to the left
  plate[1] = std::sin(at.yaw) * level + std::cos(at.yaw) * left;
  plate[2] = std::sin(at.pitch) * ahead + std::cos(at.pitch) * up;
}

// ---- What follows up to main stands for the hardware.

struct Axis {  // the paper's, a step a millisecond
  float a[4][4], b[4], c[4];
  std::array<float, 4> x{};
  float step(float command) {
    std::array<float, 4> next{};
    float angle = 0.0f;
    for (std::size_t i = 0; i < 4; ++i) {
      next[i] = b[i] * command;
      for (std::size_t j = 0; j < 4; ++j) next[i] += a[i][j] * x[j];
      angle += c[i] * next[i];
    }
    x = next;
    return angle;
  }
};

static const float lever[3] = {0.10f, 0.02f, 0.05f};

static std::array<float, 3> target(double time) {
  return {3.0f, 0.6f * static_cast<float>(std::sin(1.2 * time)), 0.1f};
}

// What the detector gives: the plate in the optical frame, when the gimbal has these angles.
static std::array<float, 3> detection(const std::array<float, 3> &plate, const Angles &at) {
  const float level = std::cos(at.yaw) * plate[0] + std::sin(at.yaw) * plate[1];
  const float left = -std::sin(at.yaw) * plate[0] + std::cos(at.yaw) * plate[1];
  const float ahead = std::cos(at.pitch) * level + std::sin(at.pitch) * plate[2];
  const float up = -std::sin(at.pitch) * level + std::cos(at.pitch) * plate[2];
  return {-(left - lever[1]), -(up - lever[2]), ahead - lever[0]};
}

// Whether a pellet that leaves the pivot now meets the plate.
static bool hits(float pitch, float yaw, double now) {
  const double speed = 18.0, drag = 0.019, dt = 1e-3;
  double x[3] = {0.0, 0.0, 0.0};
  double v[3] = {speed * std::cos(pitch) * std::cos(yaw), speed * std::cos(pitch) * std::sin(yaw), speed * std::sin(pitch)};
  double t = 0.0;
  for (; x[0] < 3.0 && t < 1.0; t += dt) {
    const double norm = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int k = 0; k < 3; ++k) {
      v[k] += dt * (-drag * norm * v[k] - (k == 2 ? 9.81 : 0.0));
      x[k] += dt * v[k];
    }
  }
  const auto plate = target(now + t);
  return std::hypot(x[1] - static_cast<double>(plate[1]), x[2] - static_cast<double>(plate[2])) < 0.06;
}

int main() {
  Axis pitch{{{0.985f, -0.039f, 0.015f, -0.004f}, {0.071f, 0.905f, 0.084f, 0.331f}, {0.019f, -0.139f, -0.813f, 0.542f},
              {0.025f, 0.213f, -0.531f, -0.641f}}, {-7.782e-6f, -3.569e-5f, -1.1e-4f, -3e-4f},
             {1183.0f, 12.61f, 0.1683f, -29.35f}, {}};
  Axis yaw{{{0.995f, -0.007f, 0.0002f, -0.008f}, {0.052f, -0.267f, -0.551f, 0.696f}, {-0.006f, 0.422f, -0.799f, -0.419f},
            {0.049f, 0.639f, 0.228f, 0.156f}}, {-1.2747618e-7f, -2.44165116e-6f, 1.3401076e-8f, -9.29051377e-9f},
           {-83530.0f, -1378.0f, -372.7f, 207.4f}, {}};
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  struct Frame {
    double arrives, stamp;
    std::array<float, 3> plate;
  };
  std::deque<Frame> frames;

  // ---- The loop of your robot begins here.
  if (policy_self_test() != 0) return std::puts("this compiler or C library computes otherwise"), 1;
  History history;
  policy_memory memory;
  policy_seen seen{};
  policy_reset(&memory);
  policy_verdict verdict{};
  double decided = 0.0;
  Angles was{};
  int shots = 0, hit = 0;
  for (int tick = 1; tick <= 20000; ++tick) {
    const double now = 1e-3 * tick;
    // Send the command, unless the gate is disarmed; read the encoders.
    const Angles angles{now, pitch.step(verdict.angle[0]), yaw.step(verdict.angle[1])};
    history.add(angles);
    if (tick % 10 == 0) {  // the camera exposes; 15 ms later the program has the detection
      auto plate = detection(target(now), angles);
      for (std::size_t k = 0; k < 3; ++k) plate[k] += (k == 2 ? 0.02f : 0.004f) * normal(random);
      frames.push_back({now + 0.015, now - policy_stamp_offset_s, plate});
    }
    // Decide once a period, and hold the command between.
    if (now - decided < static_cast<double>(policy_period_s) - 1e-6) continue;
    seen.found = 0;
    for (; !frames.empty() && frames.front().arrives <= now; frames.pop_front()) {  // the newest frame counts
      const double exposed = frames.front().stamp + policy_stamp_offset_s;
      plate_from_camera(frames.front().plate.data(), history.at(exposed), lever, seen.plate);
      seen.frame_age = static_cast<float>(now - exposed);
      seen.found = 1;
    }
    seen.elapsed = static_cast<float>(now - decided);
    seen.angle[0] = angles.pitch, seen.angle[1] = angles.yaw;
    seen.rate[0] = (angles.pitch - was.pitch) / seen.elapsed, seen.rate[1] = (angles.yaw - was.yaw) / seen.elapsed;
    seen.muzzle_speed = 18.0f;
    seen.shots_left = 1e6f;      // the referee's heat limit, where there is one
    seen.switch_on = now > 0.6;  // the operator's switch, which goes on after half a second of good input
    was = angles;
    if (policy_decide(&memory, &seen, &verdict) != 0) std::puts(policy_reason_text(verdict.cause));
    decided = now;
    if (policy_should_fire(&memory, &seen)) {
      ++shots;
      hit += hits(angles.pitch + 0.0035f * normal(random), angles.yaw + 0.0035f * normal(random), now);
    }
  }
  std::printf("%d shots, %d hits\n", shots, hit);
}
