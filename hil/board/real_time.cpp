// SPDX-License-Identifier: GPL-3.0-or-later
// Runs a board at the pace of the wall clock, its UART on a pseudo-terminal.
#include "real_time.hpp"

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <sched.h>
#include <termios.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>

namespace board {
namespace {

constexpr int SLICE_PERIODS = 3;  // 96 us between two looks at the line and the clock
constexpr long long SECOND_NS = 1000000000;
constexpr long long SLICE_NS =
    SLICE_PERIODS * SECOND_NS * SIM_CYCLES_PER_PERIOD / static_cast<long long>(SIM_CPU_HZ);
constexpr long long BEHIND_NS = 50 * 1000000;  // a longer delay of this process is not made up
constexpr int PRIORITY = 20;                   // of SCHED_FIFO, above that of the host's exchange
constexpr std::size_t READ_BYTES = 256;

// Sensors at rest: no current, 18 V, trigger released, 25 degC (docs/architecture.md).
constexpr SimInputs REST = {{512, 720, 102, 154}, {}, 0, 0, 0, {}};

volatile std::sig_atomic_t stopped = 0;

void stop(int) {
    stopped = 1;
}

long long clock_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * SECOND_NS + now.tv_nsec;
}

void sleep_until(long long at_ns) {
    const timespec at = {static_cast<time_t>(at_ns / SECOND_NS),
                         static_cast<long>(at_ns % SECOND_NS)};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
}

// The board's end of a pseudo-terminal. With no reader, bytes are lost as on a wire.
class Terminal {
public:
    Terminal() {
        int slave = -1;
        if (openpty(&master_, &slave, name_, nullptr, nullptr) != 0) {
            throw BoardError("no pseudo-terminal is available");
        }
        termios raw{};
        tcgetattr(slave, &raw);
        cfmakeraw(&raw);
        tcsetattr(slave, TCSANOW, &raw);
        close(slave);
        fcntl(master_, F_SETFL, O_NONBLOCK);
    }
    Terminal(const Terminal &) = delete;
    Terminal &operator=(const Terminal &) = delete;
    ~Terminal() { close(master_); }

    const char *name() const { return name_; }

    void receive(Bench &bench) const {
        std::uint8_t bytes[READ_BYTES];
        const ssize_t count = read(master_, bytes, sizeof bytes);
        for (ssize_t k = 0; k < count; ++k) {
            bench.receive(bytes[k]);
        }
    }

    void send(const std::uint8_t *bytes, std::size_t count) const {
        pollfd line = {master_, POLLOUT, 0};
        if (count == 0 || poll(&line, 1, 0) < 1 || (line.revents & POLLHUP) != 0) {
            return;
        }
        if (write(master_, bytes, count) < 0) {
            return;  // the reader's buffer is full: lost
        }
    }

private:
    int master_ = -1;
    char name_[64] = {};
};

// One slice of simulated time; false: the power was cut.
bool run_slice(Bench &bench, const Terminal &terminal) {
    std::uint8_t sent[SLICE_PERIODS * SIM_BYTES_MAX];
    std::size_t count = 0;
    terminal.receive(bench);
    for (int k = 0; k < SLICE_PERIODS; ++k) {
        SimOutputs outputs;
        if (!bench.period(REST, outputs)) {
            return false;
        }
        std::memcpy(&sent[count], outputs.tx, outputs.tx_count);
        count += outputs.tx_count;
    }
    terminal.send(sent, count);
    return true;
}

// A real board is not delayed by other processes: real-time priority where it is permitted.
void prioritise() {
    const sched_param parameters = {PRIORITY};
    sched_setscheduler(0, SCHED_FIFO, &parameters);
}

void announce(int stream, const char *name) {
    dprintf(stream, "%s\n", name);
}

}  // namespace

void serve_pseudo_terminal(Bench &bench, int stream, double pace) {
    struct sigaction action {};
    action.sa_handler = stop;
    sigaction(SIGTERM, &action, nullptr);
    sigaction(SIGINT, &action, nullptr);
    const Terminal terminal;
    const auto slice_ns = static_cast<long long>(static_cast<double>(SLICE_NS) / pace);
    announce(stream, terminal.name());
    prioritise();
    long long due = clock_ns();
    while (stopped == 0 && run_slice(bench, terminal)) {
        due += slice_ns;
        const long long now = clock_ns();
        if (now - due > BEHIND_NS) {
            due = now;
        }
        if (due > now) {
            sleep_until(due);
        }
    }
}

}  // namespace board
