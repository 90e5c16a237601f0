"""Texts of the message types in a log: our own, and those of ROS 2 that we use, as ROS 2 Humble has them.

A store of all ROS 2 types takes longer to load than most commands take; a test compares these with it.
"""

OWN = {
    "imutui_msgs/msg/RawPacket": """\
# One packet as received. Fixed size.
uint64 sequence           # number of the packet since the recording began
int64 host_monotonic_ns   # host's monotonic clock when the packet's last byte was read
int16[6] counts           # angular rate x y z, acceleration x y z: instrument axes and sign
uint16 temperature        # counts of the temperature sensor
uint16 ticks              # time counter, counts down, 0.79 us nominal
uint8 mode                # 0 scaled, 1 voltage
uint8 flags               # 1 packets were lost before this one, 2 stamped by the host alone, 4 a count at its limit
""",
    "imutui_msgs/msg/S1Packet": """\
# One packet S1 of an IMU381, IMU380 or IMU440 as received. Fixed size; it begins as RawPacket does.
uint64 sequence             # number of the packet since the recording began
int64 host_monotonic_ns     # host's monotonic clock when the packet's last byte was read
int16[6] counts             # angular rate x y z, acceleration x y z: instrument axes and sign
uint16 temperature          # of the x rate sensor, which the samples have; 16 bits, signed, 200/2^16 degC
uint16 ticks                # counter: packets (440, 380), or time in 1/65536 s that wraps each second (381)
uint8 mode                  # 0
uint8 flags                 # 1 packets were lost before this one, 2 stamped by the host alone, 4 a count at its limit
int16[3] rate_temperatures  # of the rate sensors x y z, 200/2^16 degC
int16 board_temperature     # 200/2^16 degC
uint16 status               # the word that manuals call BIT; no bit of it says that the readings are bad
""",
    "imutui_msgs/msg/TableReference": """\
# What is known of the table: C_nb = Rx(outer) Ry(middle) Rz(inner).
std_msgs/Header header
string kind               # level; gravity: attitude unknown, angles are NaN
float64[3] angles_deg     # outer, middle, inner
float64[3] rates_dps
""",
    "imutui_msgs/msg/TableState": """\
# What the table's controller said of its axes, which the table itself counts: no sign of a profile is in it.
std_msgs/Header header    # stamp: half-way between question and answer
float64[3] angles_deg     # outer, middle, inner; an axis that the table has not: 0
float64[3] rates_dps
uint64 uncertainty_ns     # of the stamp: half of the time between question and answer
string mode               # off, position, rate, oscillation: the most active one of the axes
string fault              # empty where there is none
""",
    "imutui_msgs/msg/Estimate": """\
# State of the filter. Biases are in the instrument's axes and sign: corrected reading = reading - bias.
std_msgs/Header header
float64[3] position_deg_m     # latitude, longitude, height
float64[3] velocity_mps       # north, east, down
float64[3] rpy_deg            # roll, pitch, yaw (3-2-1)
float64[3] accel_bias_mg      # NaN where the reference does not show it
float64[3] gyro_bias_dps
float64[3] position_sd_m      # north, east, down
float64[3] velocity_sd_mps
float64[3] rpy_sd_deg
float64[3] accel_bias_sd_mg
float64[3] gyro_bias_sd_dps
float64 nis                   # NaN for the first sample
uint8 nis_dof
bool[6] converged             # accelerometer x y z, gyro x y z
""",
}
ROS = {
    "builtin_interfaces/msg/Time": """\
int32 sec
uint32 nanosec
""",
    "std_msgs/msg/Header": """\
builtin_interfaces/Time stamp
string frame_id
""",
    "geometry_msgs/msg/Quaternion": """\
float64 x
float64 y
float64 z
float64 w
""",
    "geometry_msgs/msg/Vector3": """\
float64 x
float64 y
float64 z
""",
    "geometry_msgs/msg/Transform": """\
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""",
    "geometry_msgs/msg/TransformStamped": """\
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
""",
    "tf2_msgs/msg/TFMessage": """\
geometry_msgs/TransformStamped[] transforms
""",
    "sensor_msgs/msg/Imu": """\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
""",
    "sensor_msgs/msg/Temperature": """\
std_msgs/Header header
float64 temperature
float64 variance
""",
    "diagnostic_msgs/msg/KeyValue": """\
string key
string value
""",
    "diagnostic_msgs/msg/DiagnosticStatus": """\
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
""",
    "diagnostic_msgs/msg/DiagnosticArray": """\
std_msgs/Header header
diagnostic_msgs/DiagnosticStatus[] status
""",
    "rcl_interfaces/msg/Log": """\
byte DEBUG=10
byte INFO=20
byte WARN=30
byte ERROR=40
byte FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
""",
}
