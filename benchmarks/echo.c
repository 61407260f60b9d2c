/*
An empty node in C, over rcl: publishes one array of doubles for each joint state, until SIGINT.

A shared library, because the libraries of the ROS wheels need symbols of a Python process.
*/

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rcl/error_handling.h"
#include "rcl/rcl.h"
#include "rosidl_runtime_c/primitives_sequence_functions.h"
#include "sensor_msgs/msg/joint_state.h"
#include "std_msgs/msg/float64_multi_array.h"

#define CHECK(call) \
  do { \
    if ((call) != RCL_RET_OK) { \
      fprintf(stderr, "%s: %s\n", #call, rcl_get_error_string().str); \
      exit(1); \
    } \
  } while (0)

static volatile sig_atomic_t stopped;

static void stop(int number)
{
  (void)number;
  stopped = 1;
}

int echo(const char * name_space)
{
  signal(SIGINT, stop);
  rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_init_options_t init_options = rcl_get_zero_initialized_init_options();
  rcl_context_t context = rcl_get_zero_initialized_context();
  CHECK(rcl_init_options_init(&init_options, allocator));
  CHECK(rcl_init(0, NULL, &init_options, &context));
  rcl_node_t node = rcl_get_zero_initialized_node();
  rcl_node_options_t node_options = rcl_node_get_default_options();
  CHECK(rcl_node_init(&node, "echo", name_space, &context, &node_options));

  rcl_publisher_t publisher = rcl_get_zero_initialized_publisher();
  rcl_publisher_options_t publisher_options = rcl_publisher_get_default_options();
  publisher_options.qos.depth = 1;
  CHECK(rcl_publisher_init(
    &publisher, &node, ROSIDL_GET_MSG_TYPE_SUPPORT(std_msgs, msg, Float64MultiArray),
    "commands", &publisher_options));
  rcl_subscription_t subscription = rcl_get_zero_initialized_subscription();
  rcl_subscription_options_t subscription_options = rcl_subscription_get_default_options();
  subscription_options.qos.depth = 1;
  subscription_options.qos.reliability = RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;
  CHECK(rcl_subscription_init(
    &subscription, &node, ROSIDL_GET_MSG_TYPE_SUPPORT(sensor_msgs, msg, JointState),
    "joint_states", &subscription_options));

  rcl_wait_set_t wait_set = rcl_get_zero_initialized_wait_set();
  CHECK(rcl_wait_set_init(&wait_set, 1, 0, 0, 0, 0, 0, &context, allocator));
  sensor_msgs__msg__JointState state;
  std_msgs__msg__Float64MultiArray answer;
  if (!sensor_msgs__msg__JointState__init(&state) ||
    !std_msgs__msg__Float64MultiArray__init(&answer))
  {
    return 1;
  }
  while (!stopped) {
    CHECK(rcl_wait_set_clear(&wait_set));
    CHECK(rcl_wait_set_add_subscription(&wait_set, &subscription, NULL));
    rcl_ret_t result = rcl_wait(&wait_set, RCL_MS_TO_NS(100));
    if (result == RCL_RET_TIMEOUT) {
      continue;
    }
    CHECK(result);
    rmw_message_info_t info;
    if (rcl_take(&subscription, &state, &info, NULL) != RCL_RET_OK) {
      rcl_reset_error();
      continue;
    }
    if (answer.data.size != state.position.size) {
      rosidl_runtime_c__double__Sequence__fini(&answer.data);
      if (!rosidl_runtime_c__double__Sequence__init(&answer.data, state.position.size)) {
        return 1;
      }
    }
    memcpy(answer.data.data, state.position.data, state.position.size * sizeof(double));
    CHECK(rcl_publish(&publisher, &answer, NULL));
  }
  CHECK(rcl_subscription_fini(&subscription, &node));
  CHECK(rcl_publisher_fini(&publisher, &node));
  CHECK(rcl_node_fini(&node));
  CHECK(rcl_shutdown(&context));
  return 0;
}
