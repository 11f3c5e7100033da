// SPDX-License-Identifier: GPL-3.0-or-later
// vgroove-board: runs an ELF on a simulated ATmega; per PWM period it reads one SimInputs from
// stdin and writes one SimOutputs to stdout.
#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <vector>

#include "bench.hpp"
#include "real_time.hpp"

namespace {

using board::BoardError;

constexpr int EXIT_USAGE = 2;
constexpr int EXIT_BOARD = 3;
constexpr const char *USAGE =
    "usage: vgroove-board ELF [--mcu atmega328p|atmega2560] [--eeprom "
    "FILE] [--stats FILE] [--reset-cause por|ext|bor|wdt]\n"
    "                     [--cut CYCLE] [--brown-out CYCLE] [--hang CYCLE] "
    "[--least-dead CYCLES] [--profile FILE] [--seed N]\n"
    "                     [--boot-r2 VALUE] [--pty] [--pace FACTOR] [--stretches]\n"
    "Reads one SimInputs a PWM period on stdin, answers one SimOutputs "
    "on stdout (firmware/hal/sim/sim_io.h),\nuntil stdin ends. --cut: the power fails at "
    "this cycle; --brown-out: reset at this cycle;\n--hang: the main program enters an endless "
    "loop "
    "at this cycle, interrupts go on.\n"
    "--pty: instead of that, at the pace of the wall clock, with the UART on a pseudo-terminal, "
    "whose name is\nprinted on stdout, until SIGTERM.\n"
    "--stretches: requests of several periods, a 16-bit count and the messages; the answer, in the "
    "same form,\nends with the request, or with the first period after which the bridge has "
    "another "
    "command.\n"
    "--boot-r2: a boot loader has cleared MCUSR and left this value in register r2.\n";

std::uint8_t reset_cause(const std::string &name) {
    const char *names[] = {"por", "ext", "bor", "wdt"};
    for (unsigned bit = 0; bit < 4; ++bit) {
        if (name == names[bit]) {
            return static_cast<std::uint8_t>(1u << bit);
        }
    }
    throw BoardError("--reset-cause must be por, ext, bor or wdt, not " + name);
}

board::Cycle cycles(const std::string &name, const std::string &text) {
    char *rest = nullptr;
    const long long value = std::strtoll(text.c_str(), &rest, 10);
    if (text.empty() || *rest != '\0' || value < 0) {
        throw BoardError(name + " needs a number of cycles, not '" + text + "'");
    }
    return value;
}

double factor(const std::string &name, const std::string &text) {
    char *rest = nullptr;
    const double value = std::strtod(text.c_str(), &rest);
    if (text.empty() || *rest != '\0' || !(value >= 0.001 && value <= 100.0)) {
        throw BoardError(name + " needs a factor from 0.001 to 100, not '" + text + "'");
    }
    return value;
}

void set_option(board::Options &options, const std::string &name, const std::string &value) {
    if (name == "--mcu") {
        options.mcu = value;
    } else if (name == "--eeprom") {
        options.eeprom = value;
    } else if (name == "--stats") {
        options.stats = value;
    } else if (name == "--profile") {
        options.profile = value;
    } else if (name == "--reset-cause") {
        options.reset_cause = reset_cause(value);
    } else if (name == "--boot-r2") {
        options.boot_r2 = static_cast<std::uint8_t>(cycles(name, value));
    } else if (name == "--cut") {
        options.cut = cycles(name, value);
    } else if (name == "--brown-out") {
        options.brown_out = cycles(name, value);
    } else if (name == "--hang") {
        options.hang = cycles(name, value);
    } else if (name == "--least-dead") {
        options.least_dead = cycles(name, value);
    } else if (name == "--pace") {
        options.pace = factor(name, value);
    } else if (name == "--seed") {
        options.seed = static_cast<std::uint32_t>(cycles(name, value));
    } else {
        throw BoardError("unknown option " + name);
    }
}

board::Options parse(int count, char **arguments) {
    board::Options options;
    for (int i = 1; i < count; ++i) {
        const std::string argument = arguments[i];
        if (argument.rfind("--", 0) != 0) {
            options.elf = argument;
        } else if (argument == "--pty") {
            options.pty = true;
        } else if (argument == "--stretches") {
            options.stretches = true;
        } else if (i + 1 < count) {
            set_option(options, argument, arguments[++i]);
        } else {
            throw BoardError(argument + " needs a value");
        }
    }
    if (options.pty && options.stretches) {
        throw BoardError("--pty and --stretches exclude each other");
    }
    if (options.elf.empty()) {
        throw BoardError("no ELF file given");
    }
    return options;
}

// simavr prints to stdout: the messages get their own descriptor, other text goes to stderr.
int take_stdout() {
    const int stream = dup(STDOUT_FILENO);
    dup2(STDERR_FILENO, STDOUT_FILENO);
    return stream;
}

bool read_whole(void *data, std::size_t size) {
    std::size_t got = 0;
    while (got < size) {
        const ssize_t n = read(STDIN_FILENO, static_cast<char *>(data) + got, size - got);
        if (n <= 0) {
            return false;
        }
        got += static_cast<std::size_t>(n);
    }
    return true;
}

bool write_whole(int stream, const void *data, std::size_t size) {
    std::size_t put = 0;
    while (put < size) {
        const ssize_t n = write(stream, static_cast<const char *>(data) + put, size - put);
        if (n <= 0) {
            return false;
        }
        put += static_cast<std::size_t>(n);
    }
    return true;
}

bool same_gates(const SimOutputs &a, const SimOutputs &b) {
    return a.coast == b.coast && a.compare == b.compare && a.dead_counts == b.dead_counts;
}

// Simulates the PWM periods of a request one after the other and appends their outputs to `answer`.
// Stops after the first period whose outputs command the bridge otherwise than `gates`, and stores
// that command in `gates`. Returns false when the run has ended: the power is cut.
bool run_stretch(board::Bench &bench, const std::vector<SimInputs> &request, SimOutputs &gates,
                 std::vector<SimOutputs> &answer) {
    for (const SimInputs &inputs : request) {
        SimOutputs outputs;
        if (!bench.period(inputs, outputs)) {
            return false;
        }
        answer.push_back(outputs);
        if (!same_gates(outputs, gates)) {
            gates = outputs;
            break;
        }
    }
    return true;
}

// Writes an answer with a single call: the number of its periods (16 bit), then the outputs of
// each. An answer without periods is not written.
bool write_answer(int stream, const std::vector<SimOutputs> &answer) {
    const auto count = static_cast<std::uint16_t>(answer.size());
    std::vector<char> message(sizeof count + answer.size() * sizeof(SimOutputs));
    std::memcpy(message.data(), &count, sizeof count);
    std::memcpy(message.data() + sizeof count, answer.data(), answer.size() * sizeof(SimOutputs));
    return answer.empty() || write_whole(stream, message.data(), message.size());
}

// --stretches: a request is a count and as many SimInputs, its answer a count and the SimOutputs
// up to the first that differs from those before in the bridge's command.
void serve_stretches(board::Bench &bench, int stream) {
    SimOutputs gates{};
    gates.coast = 1;
    std::vector<SimInputs> request;
    std::vector<SimOutputs> answer;
    std::uint16_t count = 0;
    bool goes_on = true;
    while (goes_on && read_whole(&count, sizeof count)) {
        request.resize(count);
        answer.clear();
        if (!read_whole(request.data(), count * sizeof(SimInputs))) {
            return;
        }
        try {
            goes_on = run_stretch(bench, request, gates, answer);
        } catch (const BoardError &) {
            write_answer(stream, answer);
            throw;
        }
        goes_on = write_answer(stream, answer) && goes_on;
    }
}

void serve(board::Bench &bench, int stream) {
    SimInputs inputs;
    SimOutputs outputs;
    while (read_whole(&inputs, sizeof inputs) && bench.period(inputs, outputs) &&
           write_whole(stream, &outputs, sizeof outputs)) {
    }
}

void write_text(const std::string &path, const std::string &text) {
    std::ofstream file(path);
    file << text;
    if (!file) {
        throw BoardError("cannot write " + path);
    }
}

void finish(const board::Options &options, const board::Bench &bench) {
    bench.save_eeprom();
    if (!options.stats.empty()) {
        write_text(options.stats, bench.statistics());
    }
    if (!options.profile.empty()) {
        write_text(options.profile, bench.address_table());
    }
}

int run(const board::Options &options, int stream) {
    const auto bench = std::make_unique<board::Bench>(options);
    int code = EXIT_SUCCESS;
    try {
        if (options.pty) {
            board::serve_pseudo_terminal(*bench, stream, options.pace);
        } else if (options.stretches) {
            serve_stretches(*bench, stream);
        } else {
            serve(*bench, stream);
        }
    } catch (const BoardError &error) {
        std::fprintf(stderr, "vgroove-board: %s\n", error.what());
        code = EXIT_BOARD;
    }
    finish(options, *bench);
    return code;
}

}  // namespace

int main(int count, char **arguments) {
    std::signal(SIGPIPE, SIG_IGN);  // a reader that ends early is the end of the run, see finish()
    const int stream = take_stdout();
    board::Options options;
    try {
        options = parse(count, arguments);
    } catch (const BoardError &error) {
        std::fprintf(stderr, "vgroove-board: %s\n%s", error.what(), USAGE);
        return EXIT_USAGE;
    }
    try {
        return run(options, stream);
    } catch (const BoardError &error) {
        std::fprintf(stderr, "vgroove-board: %s\n", error.what());
        return EXIT_BOARD;
    }
}
